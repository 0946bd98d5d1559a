"""Bota's serial protocol, and its driver on the emulated sensor, over a pseudo terminal."""

import itertools
import random
import sys
from collections import Counter

import pytest
from sensor_reading import (
    check_times_rise,
    read_some,
    read_until,
    read_until_fault,
    read_until_lost,
)
from waiting import check_refused

from mmt.devices.drivers import load_device
from mmt_devices.bota.frames import (
    OVERRANGE,
    RAW,
    SIZE,
    SKIPPED,
    BotaFrame,
    FrameStream,
    checksum,
    pack_frame,
)

if sys.platform != "linux":
    pytest.skip("the emulated port is for Linux", allow_module_level=True)

from mmt_devices.bota.emulated import EmulatedBota

FORCE = (0.5, -0.25, 2.0)
NEAR = pytest.approx(FORCE, abs=0.06)
PERIOD_NS = 51 / 51_200 * 1e9


@pytest.fixture
def emulated(started):
    return started(EmulatedBota(lambda _time_ns: FORCE))


@pytest.fixture
def make(emulated, connected):
    """Connects a driver of the emulated sensor that has these options besides."""
    return lambda **more: connected(load_device("bota-serial", {**emulated.options, **more}))


@pytest.fixture
def sensor(make):
    return make()


def bitwise_crc(content):
    """CRC-16/X.25 as its definition has it."""
    crc = 0xFFFF
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8408 if crc & 1 else crc >> 1
    return crc ^ 0xFFFF


def test_the_checksum_is_x25():
    assert checksum(b"123456789") == 0x906E  # the catalogues' check value
    generator = random.Random(3)
    for length in range(40):
        content = generator.randbytes(length)
        assert checksum(content) == bitwise_crc(content)


def test_a_frame_is_37_bytes_in_the_documented_order():
    frame = BotaFrame(5, (1.0, 2.0, 3.0, 0.5, 0.25, -1.0), 0x01020304, 30.0)
    wire = pack_frame(frame)
    assert len(wire) == SIZE
    assert wire[:3] == b"\xaa\x05\x00"
    assert wire[3:7] == b"\x00\x00\x80\x3f"
    assert wire[27:31] == b"\x04\x03\x02\x01"
    assert FrameStream(Counter()).feed(wire) == [frame]


def test_frames_are_found_however_the_bytes_are_split():
    generator = random.Random(5)
    frames = [BotaFrame(0, (k, 0.0, 1.0, 0.0, 0.0, 0.0), 1000 * k, 20.0) for k in range(50)]
    content = b"App Init\r\n\xaa" + b"".join(map(pack_frame, frames))
    stream = FrameStream(Counter())
    found = []
    while content:
        length = generator.randrange(1, 60)
        found += stream.feed(content[:length])
        content = content[length:]
    assert found == frames
    assert stream.faults["broken frame"] == 1
    stream.feed(bytes(10 * SIZE))
    assert stream.faults["broken frame"] == 11


def test_forces_come_at_the_rate_of_the_filter_by_the_sensors_clock(emulated, sensor):
    assert emulated.filter == (51, 0, 0, 1)
    readings = read_some(sensor, 200)
    steps = sorted(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert steps[0] > 0
    assert steps[100] == pytest.approx(PERIOD_NS, abs=1000)
    assert all(reading.value == NEAR for reading in readings)
    assert sensor.latency_ns == round(1e9 * 370 / 460_800)  # the time on the line
    assert not sensor.faults.keys() - {"lost frame"}  # a busy machine loses some


@pytest.mark.parametrize(
    ("options", "deaf", "wanted", "period_ns"),
    [
        ({"sinc_length": 64, "fir": True}, False, (64, 0, 0, 0), 1.25e6),
        ({"configure": False}, True, (512, 0, 0, 1), 1e7),  # it is left as it is
    ],
)
def test_the_filter_is_set_as_the_options_say(emulated, make, options, deaf, wanted, period_ns):
    emulated.deaf = deaf
    readings = read_some(make(**options), 10)
    assert emulated.filter == wanted
    steps = sorted(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert steps[4] == pytest.approx(period_ns, abs=1000)


def test_the_counter_of_microseconds_wraps_unseen(started, connected):
    emulated = started(EmulatedBota(lambda _time_ns: FORCE, start_us=2**32 - 700_000))
    sensor = connected(load_device("bota-serial", emulated.options))
    wrapped_ns = (2**32 + 50_000) * 1000
    readings = read_until(sensor, lambda come: come and come[-1].time_ns > wrapped_ns)
    assert "restart" not in sensor.faults
    check_times_rise(readings)


def test_it_is_switched_from_text_and_raw_values_to_forces_whose_time_survives_a_restart(
    emulated, make
):
    emulated.text, emulated.calibrated = True, False
    sensor = make()
    readings = read_some(sensor)
    assert readings[-1].value == NEAR
    emulated.repeat(3)
    readings += read_until_fault(sensor, "repeated frame", 3)
    emulated.restart()
    check_times_rise(readings + read_until_fault(sensor, "restart"))


def test_flipped_bits_and_half_frames_are_survived(emulated, sensor):
    readings = read_some(sensor)
    faults = (
        lambda: emulated.flip(4),
        lambda: emulated.cut(5),
        lambda: emulated.cut(36, 37, 0, 1),
        lambda: emulated.garble(b"garbage \xaa\x00\xff"),
    )
    for fault in faults:
        fault()
        readings += read_until_fault(sensor, "broken frame")
        readings += read_some(sensor)
    assert all(reading.value == NEAR for reading in readings)  # the CRC sees them all
    check_times_rise(readings)
    assert sensor.faults["lost frame"] >= 4


def test_a_gap_is_counted_and_no_error_in_time(emulated, make):
    sensor = make(silence_ms=10_000)
    before = read_some(sensor)
    emulated.cut(*[0] * 100)
    readings = before[-1:] + read_until_fault(sensor, "lost frame", 100) + read_some(sensor)
    longest_ns = max(b.time_ns - a.time_ns for a, b in itertools.pairwise(readings))
    assert longest_ns >= 100 * PERIOD_NS


def test_silence_is_lost(emulated, make, sensor):
    read_some(sensor)
    emulated.stall()
    read_until_lost(sensor, r"no record for \d+ ms; check its power, its cable")
    sensor.close()
    check_refused(lambda: make(start_s=0.2), r"used in 0\.2 s; nothing comes; check its power")


def test_raw_values_in_the_place_of_forces_are_told(emulated, make):
    words = r"values of its gauges .*: switch its calibration matrix on"
    sensor = make(start_s=0.3)
    read_some(sensor)
    emulated.status = RAW
    read_until_lost(sensor, words)
    assert sensor.faults["raw measurements"] > 0
    check_refused(sensor.connect, words)


def test_what_the_sensor_could_not_measure_is_counted_and_what_is_impossible_left_out(
    emulated, make
):
    sensor = make(range_n=[2.0, 2.0, 2.0])
    emulated.status = OVERRANGE | SKIPPED
    assert read_until_fault(sensor, "overrange", 5)[-1].value == NEAR
    assert sensor.faults["skipped measurements"] >= 5
    emulated.truth = lambda _time_ns: (0.0, 0.0, 3.0)
    read_until_fault(sensor, "overload", 5)
    emulated.truth = lambda _time_ns: (0.0, 0.0, float("nan"))
    read_until_fault(sensor, "impossible value", 5)


@pytest.mark.parametrize(
    ("fault", "options", "words"),
    [
        (("header", 0xAB), {}, "or the model speaks another protocol"),
        (("text", True), {"configure": False}, "text comes: set its data format to binary"),
        (("deaf", True), {}, "not answer the command 'C'; its frames come, but what is"),
        (("refusal", 3), {}, r"it refuses the command 'C' \(code 3\): switch it off"),
        # with code 0 it refuses nothing
        (("refusal", 0), {"baud": 115_200}, "the baud rate is probably not 115200"),
        (("refusal", 0), {"baud": 115_200, "configure": False}, "is probably not 115200"),
    ],
)
def test_what_keeps_it_from_being_used_is_explained(
    emulated, make, monkeypatch, fault, options, words
):
    monkeypatch.setattr("mmt_devices.bota.driver._ANSWER_S", 0.1)
    setattr(emulated, *fault)
    check_refused(lambda: make(start_s=0.3, sinc_length=256, **options), words)
