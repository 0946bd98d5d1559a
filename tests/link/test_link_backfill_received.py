"""What a follower sends again is taken, given up or rejected; by the leader's side alone."""

import numpy as np
import pytest
from link_samples import CHANNELS, frames

from mmt.core.frames import LARGEST_QUANTITY, frame_dtype
from mmt.link.backfill import BackfillReceiver
from mmt.link.endpoint import Endpoint, LeaderEvents
from mmt.link.incoming import LATEST_NS
from mmt.link.protocol import MAX_RANGES, MISSING, encode_event

DTYPE = frame_dtype(CHANNELS)
RANGES = [(2 * k, 2 * k + 1) for k in range(MAX_RANGES + 9)]


class Received:
    """A receiver with its server, reader and outbox, and what it does with them."""

    def __init__(self):
        self.rejected = []
        self.filled = []
        self.gone = []
        self.settled = []
        self.errors = []
        self.sent = []
        self.reject = self.rejected.append
        events = LeaderEvents(
            on_frames=lambda *_: None,
            on_backfill=lambda block: self.filled.append(block["sequence"].tolist()),
            on_gone=lambda ranges: self.gone.append(list(ranges)),
            on_settle=self._settle,
            on_error=self.errors.append,
        )
        endpoint = Endpoint(self, 1, 1000, events, print)
        endpoint.outbox = self
        self.receiver = BackfillReceiver(DTYPE, endpoint, events)

    def is_plausible(self, sent, arrival_ns):
        return arrival_ns > 0 and sent < 1000

    def put(self, records, message):
        self.sent.append((records, message))

    def _settle(self, sent):
        self.settled.append(sent)
        return RANGES[:sent]

    def give(self, event, *payload):
        return self.receiver.handlers[event](*payload)


@pytest.mark.parametrize(
    "payload",
    [
        (), (b"",), (b"x",), (bytes(41),), (bytes(101 * DTYPE.itemsize),), ("text",), (None,),
        ([[1, 0]],), ({},), ({"frames": -1},), ({"frames": 2**32 + 1},), ({"frames": "1"},),
        (frames(0).tobytes(), frames(1).tobytes()), ([[0, 1]], [[0, 1]]),
        ({"frames": 1}, {"frames": 1}),
    ],
)  # fmt: skip
def test_what_is_malformed_is_rejected(payload):
    link = Received()
    assert [link.give(event, *payload) for event in link.receiver.handlers] == [
        None,
        None,
        {"missing": []},
    ]
    assert link.rejected == ["malformed back-fill", "malformed gone", "malformed settle"]
    assert link.filled == link.gone == link.settled == link.errors == []


def test_frames_that_cannot_be_measured_are_given_up_where_they_are_filled_in():
    link, block = Received(), frames(5, 100)
    block["force_n"][1, 2], block["position_mm"][2, 0] = np.nan, -1.001 * LARGEST_QUANTITY
    block["time_ns"][3:7] = (0, LATEST_NS - 1, -1, LATEST_NS)
    block["force_n"][0] = LARGEST_QUANTITY
    link.give("backfill", block.tobytes())
    assert link.filled == [[5, 8, 9, *range(12, 105)]]
    assert link.gone == [[(6, 8), (10, 12)]]
    link.give("backfill", block[1:3].tobytes())
    assert link.gone[1:] == [[(6, 8)]]
    assert link.rejected == ["unusable back-fill"] * 2
    link.give("backfill", frames(3).tobytes())
    link.give("gone", [[1, 3]])
    assert (link.filled[1:], link.gone[2:], link.errors) == ([[3]], [[(1, 3)]], [])


def test_at_the_end_the_follower_hears_what_is_missing():
    link = Received()
    for sent, listed in ((0, 0), (1000, 0), (4, 4), (0, 0), (999, MAX_RANGES)):
        assert link.give("settle", {"frames": sent}) == {"missing": RANGES[:listed]}
        assert link.receiver.settling is (4 in link.settled)
    assert link.settled == [0, 4, 0, 999]
    link.receiver.request(iter(RANGES))
    assert link.sent == [(0, encode_event(MISSING, RANGES[:MAX_RANGES]))]


def test_what_a_service_raises_is_handed_to_it():
    link, unusable = Received(), frames(0)
    unusable["force_n"] = np.inf
    del link.filled, link.gone, link.settled
    link.give("backfill", frames(0).tobytes())
    link.give("backfill", unusable.tobytes())
    link.give("gone", [[0, 1]])
    assert link.give("settle", {"frames": 5}) == {"missing": []}
    assert [type(error) for error in link.errors] == [AttributeError] * 4
