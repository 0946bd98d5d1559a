from mmt.core.frames import frame_dtype
from mmt.leader.remote import ClockNotes
from mmt.link.clock_exchange import ClockResponder
from mmt.link.clock_offset import ClockJump
from mmt.link.incoming import BlockReader
from mmt.link.queue import SendQueue

MS = 1_000_000
PERIOD_NS = 50 * MS


class Known:
    """A follower's clock that is ahead, and the notes of it."""

    def __init__(self, other="elsewhere"):
        self.clock = ClockResponder(
            BlockReader(frame_dtype(), "frames"), SendQueue(1), lambda _: None
        )
        self.clock.start_connection(other)
        self.noted = []
        self.notes = ClockNotes(self.clock, self.noted.append)
        self._exchanges = 0

    def run(self, exchanges):
        """Exchange at 20 Hz, and look after each."""
        for _ in range(exchanges):
            self._exchanges += 1
            self.clock.add(self._exchanges * PERIOD_NS, 7_000 * MS - MS, 7_000 * MS + MS)
            self.notes.record_if_due()


def test_the_offset_is_noted_at_first_every_ten_seconds_and_at_the_end():
    known = Known()
    known.run(7)
    assert known.noted == []
    known.run(450)
    times_ns = [note["clock_time_ns"] for note in known.noted]
    assert times_ns == [8 * PERIOD_NS, 208 * PERIOD_NS, 408 * PERIOD_NS]
    known.notes.record_if_due(last=True)
    known.notes.record_if_due(last=True)
    assert len(known.noted) == 4
    assert known.noted[-1] == {
        "event": "clocks compared",
        "clock_time_ns": 457 * PERIOD_NS,
        "clock_offset_ns": 7_000 * MS,
        "clock_drift_ppm": 0.0,
        "clock_uncertainty_ns": MS,
        "same_clock": False,
    }


def test_after_a_jump_it_is_noted_anew():
    known = Known()
    known.run(20)
    sentence, details = known.notes.jumped(ClockJump(21 * PERIOD_NS, -2_500 * MS))
    assert sentence == "clocks: the follower's jumped by -2.500 s against the one here"
    assert details == {"clock_time_ns": 21 * PERIOD_NS, "clock_step_ns": -2_500 * MS}
    known.run(1)
    assert len(known.noted) == 2
