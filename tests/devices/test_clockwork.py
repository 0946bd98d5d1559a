"""The thread in which emulated devices take their turns."""

import threading
from itertools import pairwise

from waiting import until

from mmt.testing.emulated import Clockwork

MS = 1_000_000


def threads():
    return [each for each in threading.enumerate() if each.name == "emulated devices"]


def noting(times, period_ns):
    """Return turns that note when they were, the next due a period later."""

    def turn(now_ns):
        times.append(now_ns)
        return now_ns + period_ns

    return turn


def test_devices_share_a_thread_that_ends_with_the_last_and_can_begin_again():
    clockwork = Clockwork(MS)
    often = []
    seldom = []
    quick, slow = noting(often, MS // 2), noting(seldom, 5 * MS)
    before = len(threads())
    clockwork.add(quick)
    clockwork.add(slow)
    until(lambda: len(often) > 20 and len(seldom) > 2)
    assert len(threads()) == before + 1
    clockwork.remove(quick)
    seen = len(often)
    until(lambda: len(seldom) > 6)
    assert len(often) == seen
    clockwork.remove(slow)
    clockwork.remove(slow)
    assert len(threads()) == before
    clockwork.add(quick)
    until(lambda: len(often) > seen + 3)
    clockwork.remove(quick)
    assert all(late - early >= MS // 2 for early, late in pairwise(often))
