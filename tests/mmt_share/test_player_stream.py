"""The sound of a page, and what of a request is believed."""

from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from player_samples import RATE_HZ, RMS_M_S2, flat_texture, textures

from mmt.core.errors import InputError
from mmt_share.player.messages import PlayRequest, parse, play_request
from mmt_share.player.motion import PointerMotion
from mmt_share.player.player import SIZE, picture
from mmt_share.player.stream import LONGEST_LEAD_S, Stream


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def motion(speed_mm_s: float = 120.0) -> PointerMotion:
    still = PointerMotion()
    still.velocity_mm_s, still.force_n, still.touches = (speed_mm_s, 0.0), 1.0, True
    return still


def request(played: int, lead: int = 480, number: int = 0) -> PlayRequest:
    return PlayRequest(number, 0.0, played, lead, 0, ())


@pytest.mark.parametrize("model_hz", [1000.0, 10_000.0])
@pytest.mark.parametrize("rate_hz", [44_100, 48_000])
def test_the_sound_has_the_level_of_the_model(model_hz: float, rate_hz: int) -> None:
    clock = Clock()
    stream = Stream([flat_texture(2.0, rate_hz=model_hz)], rate_hz, clock=clock)
    sounds = []
    for _ in range(1000):
        clock.now_s += 0.01
        sounds.append(stream.next(request(stream.sent), motion(), 0).sound_m_s2)
    sound = np.concatenate(sounds)
    assert len(sound) == stream.sent == 480_000
    assert np.sqrt(np.mean(sound[rate_hz:] ** 2)) == pytest.approx(2.0, rel=0.1)
    assert stream.delay_s == pytest.approx(8.0 / model_hz, rel=0.01)


def test_a_page_has_as_much_ahead_as_it_asks_for_and_no_more() -> None:
    clock = Clock()
    clock.now_s = 5.0
    stream = Stream(textures(), RATE_HZ, clock=clock)
    assert len(stream.next(request(0, 960), motion(), 0).sound_m_s2) == 960
    assert len(stream.next(request(256, 960), motion(), 0).sound_m_s2) == 256
    assert len(stream.next(request(300, 480), motion(), 0).sound_m_s2) == 0
    claimed = stream.next(request(10**9, 10**9), motion(), 0)  # it has not played what it has not
    assert len(claimed.sound_m_s2) <= LONGEST_LEAD_S * RATE_HZ


def test_no_page_gets_more_than_a_sound_card_plays() -> None:
    clock = Clock()
    stream = Stream(textures(), RATE_HZ, clock=clock)
    for _ in range(400):
        clock.now_s += 0.001
        stream.next(request(stream.sent, 10**9), motion(), 0)
    assert stream.sent <= (1.05 * 0.4 + LONGEST_LEAD_S) * RATE_HZ


def test_what_is_left_falls_silent_without_a_click() -> None:
    clock = Clock()
    stream = Stream([flat_texture(4.0)], RATE_HZ, clock=clock)
    clock.now_s = 10.0
    stream.next(request(0, 9600), motion(), 0)
    after = stream.next(request(stream.sent, 9600), motion(), None).sound_m_s2
    assert np.abs(after[:240]).max() > 0.1
    assert np.abs(after[4800:]).max() < 1e-6
    assert np.abs(np.diff(after)).max() < 2.0  # as steep as within the vibration


def test_quick_changes_between_textures_stay_within_what_each_does() -> None:
    clock = Clock()
    stream = Stream(textures(), RATE_HZ, clock=clock)
    sounds = []
    for change in range(600):
        clock.now_s += 0.005
        sounds.append(stream.next(request(stream.sent, 240), motion(), change % 3).sound_m_s2)
    sound = np.concatenate(sounds)
    assert np.abs(sound).max() < 6.0 * max(RMS_M_S2)
    assert min(RMS_M_S2) < np.sqrt(np.mean(sound**2)) < max(RMS_M_S2)
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)))) ** 2
    beyond = spectrum[np.fft.rfftfreq(len(sound), 1 / RATE_HZ) > 650.0]
    assert beyond.sum() < 1e-4 * spectrum.sum()  # a click would be heard there


def test_a_rate_of_no_sound_card_is_refused() -> None:
    with pytest.raises(InputError, match="sound card"):
        Stream(textures(), 1000)


def test_pictures_differ_and_show_the_grain() -> None:
    first, second = picture(flat_texture(1.0, 0.2)), picture(flat_texture(1.0, 1.6))
    for relief in (first, second):
        assert relief.shape == (SIZE, SIZE)
        assert np.isfinite(relief).all()
        assert (relief.mean(), relief.std()) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert np.abs(np.diff(second)).mean() > 1.2 * np.abs(np.diff(first)).mean()


GOOD: dict[str, Any] = {
    "do": "play", "number": 1, "now_ms": 2.0, "played": 3, "lead": 4, "tile": 1,
    "points": [[1.0, 2.0, 3.0, 0.5]],
}  # fmt: skip


def test_a_request_is_read() -> None:
    expected = PlayRequest(1, 2.0, 3, 4, 1, ((1.0, 2.0, 3.0, 0.5),))
    assert play_request(GOOD, 2) == expected
    assert play_request({**GOOD, "tile": None, "points": []}, 2).tile is None


@pytest.mark.parametrize(
    "change",
    [
        {"number": -1}, {"number": 1.5}, {"number": True}, {"now_ms": "now"}, {"played": None},
        {"now_ms": float("nan")}, {"lead": 2**60}, {"tile": 2}, {"tile": -1}, {"points": {}},
        {"points": [[1.0, 2.0, 3.0]]}, {"points": [[1.0, 2.0, 3.0, -0.1]]},
        {"points": [[1.0, 2e4, 3.0, 0.5]]}, {"points": [[1.0, None, 3.0, 0.5]]},
        {"points": [[float("inf"), 2.0, 3.0, 0.5]]}, {"points": [[0.0] * 4] * 257},
        {"now_ms": 10**400}, {"points": [[1.0, 10**400, 3.0, 0.5]]},
    ],
)  # fmt: skip
def test_a_request_that_makes_no_sense_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        play_request({**GOOD, **change}, 2)


@given(st.text(max_size=60))
def test_whatever_is_said_is_read_or_refused(text: str) -> None:
    with suppress(InputError):
        assert isinstance(parse(text)["do"], str)
