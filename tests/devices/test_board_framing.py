"""The frames of both boards, accelerometer and Haptuator: there and back, spoilt, impossible."""

import pickle
from binascii import crc_hqx
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.adxl335 import framing as adxl335
from mmt.devices.haptuator import framing as haptuator
from mmt.devices.haptuator.framing import FULL_SCALE, BoardReport, BoardSamples, Reset
from mmt.devices.serial_ports import cobs_decode, cobs_encode, framed

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "accelerometer-framing.md"
U16 = st.integers(0, 2**16 - 1)
U32 = st.integers(0, 2**32 - 1)
COUNTS = st.lists(st.tuples(U16, U16, U16), min_size=1, max_size=adxl335.MOST_SAMPLES)
VALUES = st.lists(st.integers(-FULL_SCALE, FULL_SCALE), min_size=1, max_size=haptuator.MOST_SAMPLES)


class Board(NamedTuple):
    """How a board's frames are encoded and decoded, and which there are."""

    encode: Any
    decoder: Any
    frames: st.SearchStrategy[Any]

    def synchronised(self):
        """A decoder that has seen the end of an earlier frame."""
        made = self.decoder()
        made.feed(b"\0")
        return made


BOARDS = {
    "adxl335": Board(
        adxl335.encode_frame,
        adxl335.BoardDecoder,
        st.builds(adxl335.BoardFrame, U32, U32, COUNTS.map(tuple)),
    ),
    "haptuator": Board(
        haptuator.encode,
        haptuator.Decoder,
        st.builds(BoardSamples, U16, VALUES.map(tuple))
        | st.just(Reset())
        | st.builds(BoardReport, U32, U16, U16, U16, U16, U16),
    ),
}
for_each_board = pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)


@for_each_board
@given(st.data(), st.integers(1, 50))
def test_frames_come_back_however_the_bytes_are_cut(board, data, size):
    sent = data.draw(st.lists(board.frames, max_size=6))
    wires = [board.encode(frame) for frame in sent]
    assert all(wire.index(0) == len(wire) - 1 for wire in wires)
    wire, reader, got = b"".join(wires), board.synchronised(), []
    for at in range(0, len(wire), size):
        got += reader.feed(wire[at : at + size])
    assert got == sent
    assert not reader.faults
    reader.feed(bytes(3))  # zeros in a row hold no frame
    assert not reader.faults


@for_each_board
@given(st.data())
def test_a_flipped_bit_never_passes(board, data):
    frame, after = data.draw(st.tuples(board.frames, board.frames))
    wire = bytearray(board.encode(frame))
    wire[data.draw(st.integers(0, len(wire) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    reader = board.synchronised()
    assert [*reader.feed(bytes(wire)), *reader.feed(b"\0" + board.encode(after))] == [after]
    assert 1 <= reader.faults.total() <= 2  # a bit that made a zero cuts the frame in two


@for_each_board
@given(st.binary(max_size=2000), st.data())
def test_after_any_garbage_the_next_frame_is_read(board, garbage, data):
    reader, frame = board.decoder(), data.draw(board.frames)
    reader.feed(garbage)
    assert list(reader.feed(b"\0" + board.encode(frame)))[-1:] == [frame]
    assert len(pickle.dumps(reader)) < 600


def test_what_is_no_whole_frame_of_this_version_is_told_from_a_fault():
    frame = adxl335.BoardFrame(1000, 2_000_000, ((2048, 2050, 2458),))
    wire, reader = adxl335.encode_frame(frame), adxl335.BoardDecoder()
    assert list(reader.feed(wire[5:] + wire)) == [frame]  # the first half is none
    assert not reader.faults
    plain = bytes((adxl335.VERSION + 1,)) + cobs_decode(wire[:-1])[1:-2]
    checked = plain + crc_hqx(plain, 0xFFFF).to_bytes(2, "little")
    assert not reader.feed(cobs_encode(checked) + b"\0")
    assert reader.faults == {"other versions": 1}


def test_the_examples_of_the_pages_are_right():
    wire = adxl335.encode_frame(adxl335.BoardFrame(1000, 2_000_000, ((2048, 2050, 2458),)))
    assert wire.hex(" ") in PAGE.read_text(encoding="utf-8")
    wire = haptuator.encode(BoardSamples(1, (256, -2)))
    assert wire.hex(" ") == "04 01 01 01 01 06 01 fe ff 22 92 00"


def test_samples_that_do_not_fit_are_refused_and_the_most_that_do_come_back():
    for number in (0, adxl335.MOST_SAMPLES + 1):
        with pytest.raises(ValueError, match="1 to 32"):
            adxl335.encode_frame(adxl335.BoardFrame(1, 2, ((1, 2, 3),) * number))
    most = haptuator.MOST_SAMPLES
    for values in ((), (0,) * (most + 1), (FULL_SCALE + 1, 0), (0, -FULL_SCALE - 1)):
        with pytest.raises(ValueError, match=r"frame holds|beyond"):
            haptuator.encode(BoardSamples(1, values))
    full = BoardSamples(1, (0,) * most)
    assert list(BOARDS["haptuator"].synchronised().feed(haptuator.encode(full))) == [full]


@given(st.integers(0, 4), st.sampled_from([0, 1, 2, 3, 4, 5, 13, 14, 15, 242, 243, 244]))
def test_content_that_no_message_of_the_haptuators_board_has_is_counted(kind, size):
    content = bytes(range(size)[:100]).ljust(size, b"a")
    reader = BOARDS["haptuator"].synchronised()
    wire = framed(bytes((haptuator.VERSION, kind)) + content)
    found = [haptuator.encode(message) for message in reader.feed(wire)]
    assert (found, reader.faults["bad frames"]) in (([wire], 0), ([], 1))
