"""The Digital F/T's frames, registers and records, without a line."""

import math
import struct
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.errors import MmtError
from mmt.devices.ati.calibration import wrench_units
from mmt.devices.ati.digital_wire import (
    FORCE_UNITS,
    SIZE,
    TORQUE_UNITS,
    NoFrame,
    RecordStream,
    answer_length,
    calibration_start,
    checksum,
    explain_status,
    frame,
    pack_calibration,
    pack_record,
    parse_answer,
    parse_calibration,
    read_request,
    registers_of,
    write_request,
)

MS = 1_000_000
GAUGES = st.tuples(*[st.integers(-32768, 32767)] * 6)


def test_requests_are_the_documented_bytes():
    assert checksum(b"123456789") == bytes([0x37, 0x4B])  # the catalogued check value, 0x4B37
    assert read_request(10, 0x00E3, 64)[:6] == bytes.fromhex("0a 03 00e3 0040")
    assert write_request(10, 6, (1, 0x1234))[:-2] == bytes.fromhex("0a 10 0006 0002 04 0001 1234")
    assert frame(10, 0x46, b"\x55")[:3] == bytes.fromhex("0a 46 55")
    assert [answer_length(r) for r in (read_request(10, 0, 6), frame(10, 0x46, b"U"))] == [17, 5]
    assert answer_length(write_request(10, 0, (1,))) == 8


def test_an_answer_is_told_from_a_refusal_and_from_what_is_none():
    request = read_request(10, 0, 2)
    answer = frame(10, 3, bytes.fromhex("04 0001 ff00"))
    assert registers_of(parse_answer(request, answer + b"more")) == [1, 0xFF00]
    broken = [b"", b"\xff" * 20, answer[:-1], answer[:-1] + b"\0", b"\x0b" + answer[1:]]
    for received in (*broken, frame(10, 4, answer[2:-2])):
        with pytest.raises(NoFrame):
            parse_answer(request, received)
    for code, reason in ((2, "no such register"), (9, "exception 9")):
        with pytest.raises(MmtError, match=f"function 0x03 is refused: {reason}"):
            parse_answer(request, frame(10, 0x83, bytes([code])))


def packed(units=(2, 4), counts=(1000, 500), ranges=(12, 12, 17, 120, 120, 120)):
    matrix = np.arange(36.0).reshape(6, 6)
    return pack_calibration("FT1", "SI-12", matrix, units, ranges, counts, range(6), range(6, 12))


def test_a_calibration_is_read_from_its_registers():
    assert [calibration_start(number) for number in (1, 2, 16)] == [227, 419, 3107]
    registers = packed()
    assert len(registers) == 168
    assert registers[0] == 0x4654
    assert registers[32 + 2 : 32 + 4] == list(struct.unpack(">2H", struct.pack(">f", 1.0)))
    assert registers[104] == 0x0204
    assert registers[117:121] == [0, 1000, 0, 500]
    stored = parse_calibration(registers, "sensor")
    assert (stored.gains, stored.offsets) == (tuple(range(6)), tuple(range(6, 12)))


@given(
    st.text("FT0189", max_size=10),
    st.text("SI-0.12", max_size=40),
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    st.tuples(*[st.integers(1, 2**31 - 1)] * 2),
    st.lists(st.floats(2**-9, 1e6, width=32), min_size=42, max_size=42),
)
def test_a_calibration_comes_back_in_newton_and_newton_mm(serial, part, units, counts, values):
    rows, ranges = np.reshape(values[:36], (6, 6)), np.array(values[36:])
    registers = pack_calibration(serial, part, rows, units, ranges, counts, range(6), range(6, 12))
    stored = parse_calibration(registers, "sensor")
    force, torque = FORCE_UNITS[units[0] - 1], TORQUE_UNITS[units[1] - 1]
    scales = np.array(wrench_units(force, torque, ""))
    np.testing.assert_allclose(stored.matrix, (rows.T * scales / np.repeat(counts, 3)).T)
    assert (stored.serial, stored.part, stored.force_unit) == (serial[:8], part[:32], force)
    np.testing.assert_allclose(stored.limits, ranges * scales)


@pytest.mark.parametrize(
    "wrong",
    [
        {"units": (0, 4)},
        {"units": (7, 4)},
        {"units": (2, 7)},
        {"counts": (0, 1)},
        {"counts": (1000, -1)},
        {"ranges": (12, math.nan, 17, 120, 120, 120)},
        {"ranges": (12, 12, 17, 120, math.inf, 120)},
        {"ranges": (12, 12, 17, 120, 120, 0)},
    ],
)
def test_an_empty_calibration_is_explained(wrong):
    with pytest.raises(MmtError, match="sensor: it holds no usable calibration"):
        parse_calibration(packed(**wrong), "sensor")
    with pytest.raises(MmtError, match="change 'calibration_number'"):
        parse_calibration([0xFFFF] * 168, "sensor")
    endless = packed()
    endless[32:34] = 0x7F80, 0
    with pytest.raises(MmtError, match="sensor: the matrix of this calibration cannot be used"):
        parse_calibration(endless, "sensor")


def test_the_status_is_explained():
    assert explain_status(0x0022) == (
        "status 0x0022 (excitation voltage too high; supply voltage too low)"
    )
    assert explain_status(0x8000) == "status 0x8000 (meaning not known)"


def test_a_record_is_the_documented_thirteen_bytes():
    record = pack_record((0x0102, 0x0304, 0x0506, 0x0708, 0x090A, -1))
    total = sum(bytes.fromhex("0102 0506 090a 0304 0708 ffff"))
    assert record == bytes.fromhex("0102 0506 090a 0304 0708 ffff") + bytes([total & 0x7F])
    assert pack_record((0,) * 6, error=True)[-1] == 0x80
    stream, records = RecordStream(Counter()), numbered(8, 3)
    content = b"".join(map(pack_record, records)) + 2 * pack_record((1,) * 6, error=True)
    assert stream.feed(content) == [*records, None, None]
    assert stream.faults == {"error bit": 2}


@given(st.lists(GAUGES, min_size=3, max_size=12), st.data())
def test_records_are_found_however_the_bytes_are_split(gauges, data):
    content = b"".join(pack_record(each) for each in gauges)
    stream = RecordStream(Counter())
    found = []
    while content:
        size = data.draw(st.integers(1, len(content)))
        found += stream.feed(content[:size])
        content = content[size:]
    assert found == gauges
    assert not stream.faults


def numbered(first, count):
    """Return records whose sums do not fit any other place than their own by chance."""
    generator = np.random.default_rng(first)
    return [tuple(int(v) for v in row) for row in generator.integers(-9999, 9999, (count, 6))]


@given(st.integers(0, 8 * SIZE - 1))
def test_a_flipped_bit_costs_its_record_alone(bit):
    before, hit, after = numbered(1, 5), numbered(2, 1), numbered(3, 6)
    broken = bytearray(pack_record(hit[0]))
    broken[bit // 8] ^= 1 << bit % 8
    stream = RecordStream(Counter())
    content = b"".join(pack_record(each) for each in before)
    content += bytes(broken) + b"".join(pack_record(each) for each in after)
    found = stream.feed(2 * content)
    in_a_bit_that_is_not_summed = bit % 8 == 7 and bit // 8 < 12
    if not in_a_bit_that_is_not_summed:
        assert found == 2 * [*before, None, *after]
        assert stream.faults == {"error bit" if bit == 8 * SIZE - 1 else "wrong sum": 2}


@given(st.integers(1, 12))
def test_a_half_record_costs_one_record_alone(size):
    before, hit, after = numbered(4, 5), numbered(5, 1), numbered(6, 6)
    stream = RecordStream(Counter())
    content = b"".join(pack_record(each) for each in before)
    content += pack_record(hit[0])[:size] + b"".join(pack_record(each) for each in after)
    found = [each for n in range(len(content)) for each in stream.feed(content[n : n + 1])]
    assert found == [*before, None, *after]


@given(st.binary(max_size=300))
def test_any_garbage_is_survived(garbage):
    stream = RecordStream(Counter())
    stream.feed(garbage)
    records = numbered(7, 40)
    found = [r for each in records for r in stream.feed(pack_record(each))]
    assert found[-30:] == records[-30:]
