"""A follower that does not keep the rate it promised is named, a bad network is not."""

import numpy as np
import pytest

from mmt.leader.frame_rate import FrameRateWatch

SECOND_NS = 1_000_000_000


class Watched:
    """A watch that is told of frames, and what it says."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.watch = FrameRateWatch(1000.0, self.said.append)

    def stream(self, rate_hz: float, seconds: float, number: int = 0, start_s: float = 5.0) -> None:
        for count in range(round(rate_hz * seconds)):
            time_s = start_s + count / rate_hz
            self.watch.add(number + count, round(time_s * SECOND_NS))


@pytest.mark.parametrize("rate_hz", [950.0, 1000.0, 1050.0])
def test_a_rate_within_five_percent_is_nothing_to_say(rate_hz: float) -> None:
    watched = Watched()
    watched.stream(rate_hz, 10.0)
    assert watched.said == []
    assert watched.watch.fault is None


@pytest.mark.parametrize("rate_hz", [660.0, 940.0, 1060.0, 2000.0])
def test_another_rate_is_said_once_with_both_figures(rate_hz: float) -> None:
    watched = Watched()
    watched.stream(rate_hz, 1.9)
    assert watched.said == []
    watched.stream(rate_hz, 10.0, round(rate_hz * 1.9), 6.9)
    (sentence,) = watched.said
    assert "promised 1000 frames a second" in sentence
    assert f"sends {rate_hz:.0f}" in sentence
    assert watched.watch.fault == sentence


def test_a_stall_that_is_made_up_is_nothing_to_say() -> None:
    watched = Watched()
    watched.stream(900.0, 1.0)
    watched.stream(1100.0, 1.0, 900, 6.0)
    watched.stream(1000.0, 3.0, 2000, 7.0)
    assert watched.said == []


def test_a_rate_that_is_right_again_is_said() -> None:
    watched = Watched()
    watched.stream(660.0, 4.0)
    watched.stream(1000.0, 4.0, 2640, 9.0)
    assert len(watched.said) == 2
    assert watched.said[1] == "frames come at the 1000 Hz that the follower promised"
    assert watched.watch.fault is None


def test_frames_that_are_lost_are_no_rate() -> None:
    watched = Watched()
    generator = np.random.default_rng(1)
    for number in range(30_000):
        late_ns = generator.integers(0, 20_000_000)
        if generator.random() < 0.7 and not 20_000 < number < 25_000:
            watched.watch.add(number, SECOND_NS + number * 10**6 + int(late_ns))
    assert watched.said == []


def test_a_new_connection_and_a_clock_that_jumps_back_begin_anew() -> None:
    watched = Watched()
    watched.stream(1000.0, 3.0, 0, 500.0)
    watched.stream(1000.0, 3.0, 3000, 5.0)
    watched.stream(660.0, 1.5, 6000, 8.0)
    watched.watch.restart()
    watched.stream(660.0, 1.5, 0, 9.6)
    watched.watch.restart()
    watched.stream(1000.0, 5.0, 0, 99.0)
    assert watched.said == []
