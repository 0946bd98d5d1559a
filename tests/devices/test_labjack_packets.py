"""Packets of a LabJack U6: there and back, spoilt ones, and the vendor's bytes."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.labjack import packets
from mmt.devices.labjack.packets import (
    AnalogInput,
    StreamPacket,
    decode_stream,
    encode_stream,
    plan,
)

u16 = st.integers(0, 2**16 - 1)


def test_commands_are_those_of_the_vendors_library():
    # setChecksum of LabJackPython gives this one in its documentation.
    assert list(packets.command(0x0B, bytes(6))) == [7, 248, 3, 11, 0, 0, 0, 0, 0, 0, 0, 0]
    channels = (AnalogInput(0), AnalogInput(4, 10), AnalogInput(2, 1000, differential=True))
    sent = packets.stream_config(plan(channels, 1000.0))
    assert len(sent) == 14 + 2 * 3
    assert sent[1:4] == bytes((0xF8, 7, 0x11))
    assert sent[6:12] == bytes((3, 1, 3, 0, 0, 0x08))
    assert int.from_bytes(sent[12:14], "little") == 48_000
    assert sent[14:] == bytes((0, 0x00, 4, 0x10, 2, 0x80 | 0x30))
    assert packets.stream_config(plan(channels, 100.0))[11] == 0
    assert len(packets.command(0x0B, bytes(510))) == 516
    for size in (1, 512):
        with pytest.raises(ValueError, match=f"payload of {size} bytes"):
            packets.command(0x0B, bytes(size))


def test_checksums_are_folded_twice():
    assert packets.checksum8(b"") == 0
    assert packets.checksum8(b"\xff" * 5) == 0xFF  # 0x4FB
    assert packets.checksum8(b"\x80\xff\x80") == 1  # 0x1FF, then 0x100


def spoilt_ones(wire, data):
    """Return it with a bit flipped, and without its end."""
    at, bit = data.draw(st.integers(0, len(wire) - 1)), data.draw(st.integers(0, 7))
    return wire[:at] + bytes((wire[at] ^ (1 << bit),)) + wire[at + 1 :], wire[:at]


@given(
    st.integers(0, 255),
    st.sampled_from([0, 59, 60, 55]),
    st.integers(0, 2**32 - 1),
    st.lists(u16, min_size=1, max_size=25).map(tuple),
    st.data(),
)
def test_streamed_packets_come_back_and_spoilt_ones_do_not(counter, error, missed, samples, data):
    packet = StreamPacket(counter, error, missed, samples)
    wire = encode_stream(packet)
    assert len(wire) == 14 + 2 * len(samples)
    known = missed if error == packets.RECOVERED else 0
    assert decode_stream(wire, len(samples)) == packet._replace(missed=known)
    for spoilt in spoilt_ones(wire, data):
        assert decode_stream(spoilt, len(samples)) is None


CONTENT = st.binary(max_size=40) | st.integers(0, 20).map(bytes)


@given(st.integers(0, 255), CONTENT, st.binary(max_size=9), st.data())
def test_replies_come_back_and_spoilt_ones_do_not(number, content, more, data):
    content = content[: len(content) // 2 * 2]
    reply = packets.command(number, bytes(2) + content)
    assert packets.read_reply(reply + more, number) == content
    for wrong in (*spoilt_ones(reply, data), packets.command(number ^ 1, bytes(2) + content)):
        with pytest.raises(ValueError, match=r"its reply was spoilt|it sent another reply"):
            packets.read_reply(wrong, number)
    for sent in (packets.START_STREAM, packets.STOP_STREAM):
        body = bytes((sent[1] + 1, number, 0))
        reply = bytes((packets.checksum8(body),)) + body
        assert packets.read_short_reply(reply, sent) == number
        for wrong in spoilt_ones(reply, data):
            with pytest.raises(ValueError, match="it sent another reply"):
                packets.read_short_reply(wrong, sent)


@given(st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(content):
    decode_stream(content, 3)
    for read in (
        lambda: packets.read_reply(content, 8),
        lambda: packets.read_short_reply(content, packets.START_STREAM),
    ):
        with contextlib.suppress(ValueError):
            read()


def test_an_error_in_a_reply_is_a_sentence():
    with pytest.raises(ValueError, match="error 50: the configuration is not valid"):
        packets.read_reply(packets.command(0x11, bytes((50, 0))), 0x11)
    with pytest.raises(ValueError, match="error 99: see its data sheet"):
        packets.read_reply(packets.command(0x11, bytes((99, 0))), 0x11)
    with pytest.raises(ValueError, match="spoilt command"):
        packets.read_reply(packets.BAD_CHECKSUM, 0x11)


@pytest.mark.parametrize("rate_hz", [100.0, 732.0, 733.0, 1000.0, 4000.0, 16_666.0])
@pytest.mark.parametrize("number", [1, 3, 9, 14])
def test_the_planned_rate_is_the_wanted_one(rate_hz, number):
    scanning = plan([AnalogInput(n) for n in range(number)], rate_hz)
    assert 1 <= scanning.interval <= 65535
    scans = scanning.scans_per_packet
    assert scans == 1 or scans == 25 // number or abs(scans - rate_hz / 1000) <= 0.5
    assert 1 <= scanning.samples_per_packet <= packets.MOST_SAMPLES
    assert scanning.clock_hz / scanning.interval == pytest.approx(rate_hz, rel=1e-4)
    assert scanning.clock_hz in {4_000_000, 48_000_000}
    assert scanning.time_ns(scanning.clock_hz) == scanning.interval * 10**9
