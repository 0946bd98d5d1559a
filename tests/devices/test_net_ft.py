"""The Net F/T's bytes and pages, and its driver on the emulated box."""

import itertools
import math
import re

import numpy as np
import pytest
from sensor_reading import check_times_rise, read_some, read_until_fault, read_until_lost
from waiting import check_refused

from mmt.core.errors import InputError, MmtError
from mmt.devices import sensor_drivers as sensor_module
from mmt.devices.ati import net_ft as net_ft_module
from mmt.devices.ati.net_ft import NetFt
from mmt.devices.ati.net_wire import (
    RECORD,
    START,
    STOP,
    explain_status,
    filter_delay_ns,
    is_broken,
    parse_page,
    parse_request,
    parse_settings,
    request,
)
from mmt.devices.drivers import load_device
from mmt.testing.emulated.net_ft import EmulatedNetFt

PAGE = """<?xml version="1.0" encoding="utf-8"?><netft><setuserfilter>4</setuserfilter>
<cfgcpf>1000000</cfgcpf><cfgcpt>2000</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>
<cfgmr>12;12;17;0.12;0.12;0.12</cfgmr><comrdte>Enabled</comrdte><comrdtrate>1000</comrdtrate>
<setbias>1;-2;3;4;5;6</setbias></netft>"""


def test_requests_and_records_are_the_documented_bytes():
    assert request(START) == bytes.fromhex("1234 0002 00000000")
    assert request(STOP) == bytes.fromhex("1234 0000 00000000")
    assert request(0x42, 7) == bytes.fromhex("1234 0042 00000007")
    assert parse_request(request(0x41, 9)) == (0x41, 9)
    assert parse_request(b"\x12\x35\0\2\0\0\0\0") is None
    assert parse_request(b"") is None
    counts = (1, -1, 1_000_000, -(2**31), 2**31 - 1, 0)
    assert RECORD.pack(0xFFFFFFFF, 7, 0x80020000, *counts) == bytes.fromhex(
        "ffffffff 00000007 80020000 00000001 ffffffff 000f4240 80000000 7fffffff 00000000"
    )


def test_a_status_is_explained():
    # where it is saturated the values are at their limit, and counted
    assert [is_broken(status) for status in (0, 0x80020000, 0x80010000)] == [False] * 3
    assert is_broken(0x80100000)
    assert is_broken(0x80000400)
    assert "saturation" in explain_status(0x80020000)
    assert "System Information" in explain_status(0x80000400)


@pytest.mark.parametrize(
    ("units", "newton", "newton_mm"),
    [(("N", "Nm"), 1.0, 1000.0), (("lbf", "lbf-in"), 4.4482216152605, 112.98482902761668)],
)
def test_a_page_becomes_settings(units, newton, newton_mm):
    page = PAGE.replace(">N<", f">{units[0]}<").replace(">Nm<", f">{units[1]}<")
    settings = parse_settings(parse_page(page), {"calsn": "FT1", "calpn": "SI-12-0.12"}, "box")
    assert settings.calibration.serial == "FT1"
    assert settings.calibration.range_n == pytest.approx(np.multiply((12, 12, 17), newton))
    assert settings.calibration.limits[3:] == pytest.approx([0.12 * newton_mm] * 3)
    assert settings.calibration.matrix[2][2] == pytest.approx(1e-6 * newton)
    assert settings.calibration.matrix[5][5] == pytest.approx(newton_mm / 2000)
    assert (settings.rate_hz, settings.filter, settings.bias) == (1000.0, 4, "1;-2;3;4;5;6")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<cfgcpf>1000000</cfgcpf>", "", "has no 'cfgcpf'"),
        (">1000000<", ">many<", "'cfgcpf' of its page is 'many', not a finite number"),
        (">1000000<", ">0<", "'cfgcpf' of its page is 0.0, not above zero"),
        ("<scfgfu>N<", "<scfgfu>st<", "unit of force 'st' is not known"),
        ("Enabled", "Disabled", "RDT is switched off"),
        ("12;12;17;", "12;12;", "six are expected"),
        (">4<", ">nan<", "'setuserfilter' of its page is 'nan', not a finite number"),
        (PAGE, "", "has no 'scfgfu'"),
    ],
)
def test_a_page_that_cannot_be_used_is_explained(old, new, words):
    with pytest.raises(MmtError, match=f"box: .*{words}"):
        parse_settings(parse_page(PAGE.replace(old, new)), {}, "box")


def test_a_filters_delay_is_that_of_the_recursion_with_its_cut_off():
    for number, cut_off_hz in enumerate((838, 326, 152, 73, 35, 18, 8, 5), start=1):
        a = 2.0**-number
        own_hz = 7000 / (2 * math.pi) * math.acos(1 - a * a / (2 * (1 - a)))
        assert own_hz == pytest.approx(cut_off_hz, rel=0.15)
        assert filter_delay_ns(number) == pytest.approx((1 - a) / a / 7000 * 1e9, abs=1)
    assert filter_delay_ns(0) == filter_delay_ns(9) == 0


@pytest.fixture
def box(started):
    return started(EmulatedNetFt(lambda _time_ns: (0.5, -0.25, 2.0)))


@pytest.fixture
def make(box, connected):
    """Connects a driver of the emulated box that has these options besides."""
    return lambda **more: connected(load_device("ati-net-ft", {**box.options, **more}))


@pytest.fixture
def sensor(make):
    return make()


def test_forces_come_by_the_sensors_own_clock(sensor):
    readings = read_some(sensor, 200)
    steps = [b.time_ns - a.time_ns for a, b in itertools.pairwise(readings)]
    period_ns = 1e9 / 2333
    records = [step / period_ns for step in steps]
    assert all(round(each) >= 1 and abs(each - round(each)) < 1e-5 for each in records)
    assert round(sorted(records)[100]) == 1
    for reading in readings:
        assert reading.value == pytest.approx((0.5, -0.25, 2.0), abs=0.01)


def test_the_box_is_set_to_the_options_once(box, make, sensor):
    assert (box.pages["comrdtrate"], box.pages["setuserfilter"]) == ("2333", "2")
    assert sensor.latency_ns == filter_delay_ns(2)
    assert load_device("ati-net-ft", {**box.options, "latency_ms": 0.7})
    assert make(latency_ms=0.7).latency_ns == 700_000


def test_the_bias_is_removed_and_survives_a_new_connection(box, sensor):
    sensor.calibrate()
    assert read_some(sensor)[-1].value == pytest.approx((0, 0, 0), abs=0.01)
    box.pages["setbias"] = "9;9;9;9;9;9"  # someone at the web page
    sensor.connect()
    assert box.pages["setbias"] == "0;0;0;0;0;0"
    assert sensor.faults["bias restored in the box"] == 1
    assert read_some(sensor)[-1].value == pytest.approx((0, 0, 0), abs=0.01)


def test_a_healthy_box_is_asked_once_and_one_of_unusable_records_not_again(box, make, monkeypatch):
    monkeypatch.setattr(net_ft_module, "_REPEAT_START_NS", 10_000_000_000)
    sensor = make(silence_ms=5000)  # which has less patience than that
    monkeypatch.setattr(net_ft_module, "_REPEAT_START_NS", 400_000_000)
    monkeypatch.setattr(sensor_module, "_REST_S", 0.8)
    sensor.calibrate()
    read_some(sensor, 100)
    assert box.requests.count(START) == 1
    assert "start request repeated" not in sensor.faults
    monkeypatch.setattr(sensor_module, "_BROKEN_NS", 800_000_000)
    box.status = 0x80000400
    read_until_lost(sensor, "status 0x80000400")
    assert box.requests.count(START) == 1


def test_lost_and_reordered_records_and_a_new_count_make_no_time_wrong(box, sensor):
    read_some(sensor)
    box.count_from(0xFFFFFFF0)  # and around its end
    readings = read_until_fault(sensor, "counted anew")
    readings += read_some(sensor, 100)
    assert sensor.faults["counted anew"] == 1
    box.loss, box.swapped = 0.1, 0.1
    readings += read_until_fault(sensor, "lost record", 20)
    readings += read_until_fault(sensor, "late record", 10)
    check_times_rise(readings)


def test_garbage_and_flipped_bits_are_survived(box, sensor):
    box.garble(b"", b"hello", bytes(35), bytes(72), bytes(2000))
    box.flip(30)
    readings = read_until_fault(sensor, "packet that is no record", 5)
    readings += read_some(sensor, 200)
    near = [r for r in readings if r.value == pytest.approx((0.5, -0.25, 2.0), abs=0.01)]
    assert len(near) >= len(readings) - 30
    assert all(abs(value) <= 4 * 17 for r in readings for value in r.value)
    span_ns = readings[-1].time_ns - readings[0].time_ns
    assert span_ns < 10e9  # no flipped number has moved the clock


def test_saturation_and_overload_are_counted_and_the_values_pass(box, sensor, caplog):
    box.status = 0x80020000
    assert read_until_fault(sensor, "saturation", 5)
    box.status, box.truth = 0, lambda _time_ns: (0.0, 0.0, 20.0)
    assert read_until_fault(sensor, "overload", 5)[-1].value[2] == pytest.approx(20.0, abs=0.1)
    (message,) = [each for each in caplog.messages if "overloaded" in each]
    assert re.match("Net F/T at .* is overloaded: beyond the range", message)


def test_a_lost_start_request_and_a_short_interruption_are_bridged(box, make):
    box.lost_starts = 2
    sensor = make(silence_ms=5000)
    assert sensor.faults["start request repeated"] >= 2
    read_some(sensor)
    box.unplug()
    read_until_fault(sensor, "start request repeated", 2)
    box.plug()
    assert read_some(sensor, 20)


def test_what_keeps_it_from_being_used_is_explained(box, make):
    with pytest.raises(InputError, match="serial number is FT00017, expected is FT00018"):
        make(serial="FT00018")
    with pytest.raises(MmtError, match=r"web page http://127.0.0.1:1/netftapi2.xml does not ans"):
        load_device("ati-net-ft", {"host": "127.0.0.1", "http_port": 1}).connect()
    box.stall()
    check_refused(make, "its web page answers, but no record comes to UDP port")
    sensor = load_device("ati-net-ft")
    assert isinstance(sensor, NetFt)
    sensor.close()
    with pytest.raises(MmtError, match=r"Net F/T at 192.168.1.1 is not connected"):
        sensor.read()
