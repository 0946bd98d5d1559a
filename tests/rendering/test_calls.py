"""Four calls render textures in somebody else's loop, in threads or without."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_samples import directed, model
from waiting import until

from mmt.core.errors import InputError, MmtError
from mmt.rendering import close, open_textures, render, touch
from mmt.texture.synthesis.generation import estimate


def expected_rms(of, *inputs):
    return estimate(of, *inputs).amplitude_m_s2


def test_a_faster_device_hears_the_same():
    texture = model(seed=2)
    slow, fast = (open_textures([texture], output_hz=rate) for rate in (1000, 8000))
    for textures in (slow, fast):
        touch(textures, 0, 150.0, force_n=1.5)
    once, often = render(slow, 20_000), render(fast, 160_000)
    # the samples are the same noise, seen at more instants: levels agree below 390 Hz
    for low, high in ((20, 150), (150, 390)):
        assert band_power(often, 8000, low, high) == pytest.approx(
            band_power(once, 1000, low, high), rel=0.05
        )
    assert band_power(often, 8000, 620, 4000) < 1e-4 * often.var()


def band_power(samples, rate_hz, low_hz, high_hz):
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / rate_hz)
    inside = (frequency >= low_hz) & (frequency < high_hz)
    return float(spectrum[inside].sum() / len(samples) ** 2)


@given(st.lists(st.integers(0, 300), min_size=1, max_size=12), st.sampled_from([1000, 2000, 44100]))
@settings(max_examples=20)
def test_the_size_of_blocks_does_not_matter(counts, output_hz):
    texture = model()
    blocks, whole = (open_textures([texture], output_hz=output_hz, seed=5) for _ in range(2))
    for textures in (blocks, whole):
        touch(textures, 0, 100.0, 20.0, 1.0)
    parts = [render(blocks, count) for count in counts]
    np.testing.assert_allclose(np.concatenate(parts), render(whole, sum(counts)), atol=1e-12)


def test_the_filter_follows_the_hand_at_its_own_rate():
    texture = model()
    textures = open_textures([texture], output_hz=1000, estimate_hz=100)
    touch(textures, 0, 200.0, force_n=2.0)
    render(textures, 5)
    before = textures.newest
    touch(textures, 0, 50.0, force_n=1.0)
    render(textures, 5)
    assert textures.newest is before
    render(textures, 1)
    assert textures.newest is not before


def test_nothing_touched_is_silent_and_so_is_a_hand_at_rest():
    textures = open_textures([model()], output_hz=2000)
    assert not render(textures, 500).any()
    touch(textures, 0, 150.0, force_n=1.5)
    assert render(textures, 500).std() > 0.05
    touch(textures, None)
    render(textures, 500)
    assert not render(textures, 500).any()
    touch(textures, 0, 0.0, 0.0, 1.5)
    assert not render(textures, 500).any()


def test_a_model_of_velocity_feels_the_heading():
    texture = directed(seed=1)
    textures = open_textures([texture], output_hz=1000)
    touch(textures, 0, 100.0, 0.0, 1.5)
    along = render(textures, 30_000).std()
    touch(textures, 0, 0.0, 100.0, 1.5)
    across = render(textures, 30_000).std()
    assert along == pytest.approx(expected_rms(texture, 100.0, 0.0, 1.5), rel=0.1)
    assert across == pytest.approx(expected_rms(texture, 0.0, 100.0, 1.5), rel=0.1)
    assert abs(along / across - 1.0) > 0.02


def test_textures_of_different_rates_are_one_output(tmp_path):
    fast = model(seed=4, rate_hz=10_000.0)
    fast.save(tmp_path / "fast.npz")
    textures = open_textures([model(), tmp_path / "fast.npz"], output_hz=2000)
    touch(textures, 1, 150.0, force_n=1.5)
    assert render(textures, 2000).std() > 0.0
    touch(textures, 0, 150.0, force_n=1.5)
    render(textures, 400)
    assert render(textures, 40_000).std() == pytest.approx(
        expected_rms(model(), 150.0, 1.5), rel=0.1
    )
    bounded = open_textures([model()], output_hz=8000, limit_m_s2=0.1)
    touch(bounded, 0, 150.0, force_n=1.5)
    assert np.abs(render(bounded, 8000)).max() == 0.1  # though the conversion overshoots


def test_estimates_in_a_thread_follow_the_clock():
    textures = open_textures([model()], threads=True, estimate_hz=200)
    touch(textures, 0, 150.0, force_n=1.5)
    until(lambda: textures.newest is not None)
    assert render(textures, 1000).std() > 0.05
    close(textures)
    close(textures)
    with pytest.raises(MmtError, match="closed"):
        render(textures, 1)


def test_samples_are_handed_to_a_sink_by_the_clock():
    blocks = []
    textures = open_textures([model()], output_hz=2000, threads=True, sink=blocks.append)
    touch(textures, 0, 150.0, force_n=1.5)
    begun = time.monotonic()
    while sum(map(len, blocks)) < 1000 and time.monotonic() < begun + 20.0:
        time.sleep(0.01)
    took = time.monotonic() - begun
    close(textures)
    samples = np.concatenate(blocks)
    assert samples.any()
    assert len(samples) <= 2000 * (took + 2.0)
    assert took > 0.2


def test_a_sink_that_fails_is_told_by_the_next_call():
    def sink(_):
        raise RuntimeError("the card is gone")

    textures = open_textures([model()], sink=sink)
    until(lambda: not textures.running)
    with pytest.raises(MmtError, match="the card is gone"):
        touch(textures, 0, 1.0)
    close(textures)


def test_what_cannot_be_opened_or_touched_is_explained(tmp_path):
    with pytest.raises(InputError, match="at least one"):
        open_textures([])
    with pytest.raises(InputError, match="No such file"):
        open_textures([tmp_path / "none.npz"])
    with pytest.raises(InputError, match="output_hz"):
        open_textures([model()], output_hz=0)
    with pytest.raises(InputError, match="estimate_hz"):
        open_textures([model()], estimate_hz=float("nan"))
    textures = open_textures([model()])
    with pytest.raises(InputError, match="there are 1"):
        touch(textures, 1)
