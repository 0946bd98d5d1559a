"""The frames of each board on a serial line: there and back, and spoilt ones."""

import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.devices.adxl335.framing import MOST_SAMPLES, BoardDecoder, BoardFrame, encode_frame
from mmt.devices.haptuator import framing
from mmt.devices.serial_ports import cobs_decode, cobs_encode

U16 = st.integers(0, 2**16 - 1)
U32 = st.integers(0, 2**32 - 1)
COUNTS = st.lists(st.tuples(U16, U16, U16), min_size=1, max_size=MOST_SAMPLES)
LEVELS = st.integers(-framing.FULL_SCALE, framing.FULL_SCALE)
VALUES = st.lists(LEVELS, min_size=1, max_size=framing.MOST_SAMPLES)
MESSAGES = st.one_of(
    st.builds(framing.BoardSamples, U16, VALUES.map(tuple)),
    st.just(framing.Reset()),
    st.builds(framing.BoardReport, U32, U16, U16, U16, U16, U16),
)
of_each_board = pytest.mark.parametrize(
    ("decoder", "encode", "contents"),
    [
        (BoardDecoder, encode_frame, st.builds(BoardFrame, U32, U32, COUNTS.map(tuple))),
        (framing.Decoder, framing.encode, MESSAGES),
    ],
    ids=["accelerometer", "haptuator"],
)


@of_each_board
@given(st.data(), st.integers(1, 50))
def test_frames_come_back_however_the_bytes_are_cut(decoder, encode, contents, data, size):
    sent = data.draw(st.lists(contents, max_size=5))
    wire = b"\0" + b"".join(map(encode, sent))
    reader, got = decoder(), []
    for at in range(0, len(wire), size):
        got.extend(reader.feed(wire[at : at + size]))
    assert got == sent
    assert not reader.faults


@given(st.binary(max_size=253))
def test_stuffed_bytes_hold_no_zero(plain):
    stuffed = cobs_encode(plain)
    assert 0 not in stuffed
    assert len(stuffed) == len(plain) + 1
    assert cobs_decode(stuffed) == plain


@of_each_board
@given(st.data())
def test_a_flipped_bit_never_passes(decoder, encode, contents, data):
    frame, after = data.draw(contents), data.draw(contents)
    wire = bytearray(encode(frame))
    wire[data.draw(st.integers(0, len(wire) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    reader = decoder()
    got = [*reader.feed(b"\0" + bytes(wire)), *reader.feed(b"\0" + encode(after))]
    assert got == [after]
    assert 1 <= reader.faults.total() <= 2  # a bit that made a zero cuts the frame in two


@of_each_board
@settings(max_examples=50)
@given(st.binary(max_size=2000), st.data())
def test_after_any_garbage_the_next_frame_is_read(decoder, encode, contents, garbage, data):
    reader, frame = decoder(), data.draw(contents)
    reader.feed(garbage)
    assert list(reader.feed(b"\0" + encode(frame)))[-1:] == [frame]
    assert len(pickle.dumps(reader)) < 600
