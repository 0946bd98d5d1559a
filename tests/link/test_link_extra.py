"""A further event: what anybody may send, and what is encoded."""

import msgpack
import numpy as np
import pytest

from mmt.core.frames import ENERGY, ENERGY_DTYPE
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.incoming import BlockReader


class Side:
    event, dtype = ENERGY, ENERGY_DTYPE

    def __init__(self):
        self.taken = []
        self.began = 0
        self.errors = []
        self.on_records = self.taken.append
        events = LeaderEvents(print, on_error=self.errors.append)
        reader = BlockReader(ENERGY_DTYPE, "frames")
        self.endpoint = Endpoint(reader, 10, 1000, events, print, extra=self)
        self.endpoint.restart()

    def restart(self):
        self.began += 1

    def read(self, *arguments):
        self.endpoint.handle_extra(*arguments)


def records(*sequence, energy_j=1.0):
    made = np.zeros(len(sequence), dtype=ENERGY_DTYPE)
    made["sequence"] = sequence
    made["energy_j"] = energy_j
    return made


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"x" * 35,
        "text",
        None,
        {"energy_j": 1.0},
        records(0, energy_j=float("nan")).tobytes(),
        records(0, energy_j=float("inf")).tobytes(),
        records(0, energy_j=1e9).tobytes(),
        records(*range(101)).tobytes(),
    ],
)
def test_what_is_malformed_is_thrown_away(payload):
    side = Side()
    side.read(payload)
    assert side.taken == []
    side.read(records(1).tobytes())
    assert len(side.taken) == 1
    assert side.errors == []


@pytest.mark.parametrize("count", [1, 100, 101, 250])
def test_records_that_come_together_after_a_stall_are_all_taken(count, monkeypatch):
    side, sent = Side(), []
    monkeypatch.setattr(side.endpoint.outbox, "put", lambda _, message: sent.append(message))
    side.endpoint.send_extra(records(*range(count)))
    for message in sent:
        side.read(msgpack.unpackb(message)["data"][1])
    assert np.array_equal(np.concatenate(side.taken), records(*range(count)))
    assert side.began == 1
    side.read(records(count - 1).tobytes())  # late
    assert sum(map(len, side.taken)) == count
    with pytest.raises(ValueError, match="energy records are of dtype"):
        side.endpoint.send_extra(np.zeros(1, dtype="<f8"))


def test_a_side_without_an_event_has_no_part_in_the_link():
    """Such as streamed force feedback, for which frames are enough."""

    class Streamed(Side):
        event = dtype = None

    side = Streamed()
    side.endpoint.send_extra(records(1))
    side.read(records(1).tobytes())
    assert (side.endpoint.extra_event, side.began, side.taken, side.errors) == ("", 0, [], [])
