"""The frames of a Haptuator's board: there and back, spoilt ones, and impossible ones."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.devices.haptuator.framing import (
    FULL_SCALE,
    MOST_SAMPLES,
    VERSION,
    BoardReport,
    BoardSamples,
    Decoder,
    Reset,
    encode,
)
from mmt.devices.serial_ports import framed

U16 = st.integers(0, 0xFFFF)
VALUES = st.lists(st.integers(-FULL_SCALE, FULL_SCALE), min_size=1, max_size=MOST_SAMPLES)
MESSAGES = st.one_of(
    st.builds(lambda n, v: BoardSamples(n, tuple(v)), U16, VALUES),
    st.just(Reset()),
    st.builds(BoardReport, st.integers(0, 2**32 - 1), U16, U16, U16, U16, U16),
)


@settings(max_examples=60)
@given(st.lists(MESSAGES, max_size=6), st.integers(1, 50))
def test_messages_survive_the_wire_in_any_pieces(messages, piece):
    content = b"\0" + b"".join(encode(message) for message in messages)
    decoder, got = Decoder(), []
    for begin in range(0, len(content), piece):
        got += decoder.feed(content[begin : begin + piece])
    assert got == messages
    assert not decoder.faults


@settings(max_examples=60)
@given(st.binary(max_size=700), MESSAGES)
def test_after_garbage_the_next_message_is_heard(garbage, message):
    decoder = Decoder()
    decoder.feed(garbage)
    assert list(decoder.feed(b"\0" + encode(message)))[-1:] == [message]


def test_a_flipped_bit_is_never_taken_for_a_message():
    content = encode(BoardSamples(7, (100, -200, 0, 32767)))
    for bit in range(8 * (len(content) - 1)):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        decoder = Decoder()
        assert list(decoder.feed(b"\0" + bytes(flipped))) == []
        assert sum(decoder.faults.values()) >= 1


def test_the_example_of_the_page_is_right():
    assert encode(BoardSamples(1, (256, -2))).hex(" ") == "04 01 01 01 01 06 01 fe ff 22 92 00"


def test_samples_that_do_not_fit_are_refused():
    for values in ((), (0,) * (MOST_SAMPLES + 1), (FULL_SCALE + 1, 0), (0, -FULL_SCALE - 1)):
        with pytest.raises(ValueError, match=r"frame holds|beyond"):
            encode(BoardSamples(1, values))


@given(st.integers(0, 4), st.sampled_from([0, 1, 2, 3, 4, 5, 13, 14, 15, 242, 243, 244]))
def test_content_that_no_message_has_is_counted(kind, size):
    wire = framed(bytes((VERSION, kind)) + bytes(range(size)[:100]).ljust(size, b"a"))
    decoder = Decoder()
    found = [encode(message) for message in decoder.feed(b"\0" + wire)]
    assert (found, decoder.faults["bad frames"]) in (([wire], 0), ([], 1))
