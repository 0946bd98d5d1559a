"""The frames of a Haptuator's board: an example, and impossible ones."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.haptuator.framing import (
    FULL_SCALE,
    MOST_SAMPLES,
    VERSION,
    BoardSamples,
    Decoder,
    encode,
)
from mmt.devices.serial_ports import framed


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
