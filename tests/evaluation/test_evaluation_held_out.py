"""Segments held out: which, and how a model that is right scores on them."""

from pathlib import Path

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.evaluation import held_out as of
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.held_out import HELD_OUT, HeldOutRecording, approximate, choose_held_out
from mmt.evaluation.texts import DEFINITIONS
from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.signals.metrics import Spectra


def segment(start, stop, vibration=None):
    values = np.zeros(stop - start) if vibration is None else vibration
    return Segment(
        start=start,
        stop=stop,
        speed_mm_s=100.0,
        velocity_mm_s=(100.0, 0.0),
        force_n=1.0,
        vibration_m_s2=values,
        time_ns=stop * 1_000_000,
        final=True,
    )


def even_model(vibration, order, power=1.0):
    """Return a model that is the same everywhere but near the edges of zero level."""
    fit = burg(vibration, order)
    lsf = reflection_to_lsf(fit.reflection)
    gain = np.prod(1 - fit.reflection**2)
    axes = np.meshgrid(np.linspace(25.0, 275.0, 6), np.linspace(0.25, 2.75, 6))
    speed, force = (axis.ravel() for axis in axes)
    level = np.full(36, power)
    return TextureModel(
        TextureSamples.isotropic(speed, force, np.tile(lsf, (36, 1)), level * gain, level),
        method="published",
    )


@pytest.mark.parametrize(("available", "taken"), [(0, 0), (1, 0), (3, 1), (9, 4), (10, 5), (80, 5)])
def test_at_most_half_and_at_most_five_are_taken(available, taken):
    segments = [segment(100 * n, 100 * n + 90) for n in range(available)]
    chosen = choose_held_out(segments, seed=3)
    assert len(chosen) == taken <= HELD_OUT
    assert len({part.start for part in chosen}) == taken


def test_choice_depends_on_the_seed_and_not_on_the_order():
    segments = [segment(100 * n, 100 * n + 90) for n in range(40)]
    first = [part.start for part in choose_held_out(segments, seed=1)]
    assert first == [part.start for part in choose_held_out(segments[::-1], seed=1)]
    assert first == sorted(first)
    assert first != [part.start for part in choose_held_out(segments, seed=2)]


def test_raw_amplitudes_of_a_right_model_score_a_quarter_of_pi():
    vibration = np.random.default_rng(5).standard_normal(400)
    recording = HeldOutRecording(segment(0, 400, vibration), 1000.0, Spectra.FOURIER)
    model = even_model(vibration, 8)
    results = [approximate(model, [recording], seed)[0] for seed in range(3)]
    assert len(recording.frequencies_hz) == 201
    assert (of.REALISATIONS, "four realisations each" in DEFINITIONS["gfc"]) == (4, True)
    for scores in zip(*((one.gfc, one.gfc_ceiling) for one in results), strict=True):
        assert np.mean(scores) == pytest.approx(np.pi / 4, abs=0.03)


def test_spectra_that_there_are_not_are_refused():
    frames, _ = simulate_session(Scene(), "plastic", 1.0, 1)
    session = RecordedSession(frames, path=Path("one"))
    with pytest.raises(InputError, match="spectra is 'raw', allowed are welch, fourier"):
        evaluate_session(session, spectra="raw")


def test_a_wrong_shape_scores_less_and_a_wrong_level_does_not():
    generator = np.random.default_rng(6)
    low = np.convolve(generator.standard_normal(420), np.ones(8) / 8, mode="valid")[:400]
    high = np.diff(generator.standard_normal(401))
    recording = HeldOutRecording(segment(0, 400, low), 1000.0)
    right = approximate(even_model(low, 10), [recording], 0)[0]
    loud = approximate(even_model(low, 10, power=100.0), [recording], 0)[0]
    wrong = approximate(even_model(high, 10), [recording], 0)[0]
    assert wrong.gfc < 0.7 < right.gfc
    assert loud.gfc == pytest.approx(right.gfc, abs=1e-9)


def test_power_error_compares_exact_with_measured_power():
    vibration = 2.0 * np.sin(np.arange(300)) + 0.1 * np.random.default_rng(1).standard_normal(300)
    recording = HeldOutRecording(segment(0, 300, vibration), 1000.0)
    result = approximate(even_model(vibration, 4, power=10 * recording.power), [recording], 0)[0]
    assert recording.power == pytest.approx(np.mean(vibration**2))
    assert result.power_error_db == pytest.approx(10.0, abs=1e-6)


def test_what_is_not_felt_of_a_segment_is_left_out_of_its_power():
    time_s = np.arange(4000) / 10_000.0
    felt = 2.0 * np.sin(2.0 * np.pi * 200.0 * time_s)
    recording = HeldOutRecording(
        segment(0, 400, felt + 3.0 * np.sin(2.0 * np.pi * 3000.0 * time_s)), 10_000.0
    )
    assert recording.power == pytest.approx(2.0)
    errors_db = recording.bands_db(2.0 * recording.amplitude)
    assert np.isnan(errors_db[0])  # 10 to 15 Hz has no bin
    np.testing.assert_allclose(errors_db[1:], 20.0 * np.log10(2.0))


@pytest.mark.parametrize("length", [31, 64, 65, 130])
def test_short_segments_are_scored(length):
    vibration = np.random.default_rng(length).standard_normal(length)
    recording = HeldOutRecording(segment(0, length, vibration), 1000.0)
    result = approximate(even_model(vibration, 3), [recording], 0)[0]
    assert 0.5 < result.gfc <= 1.0
    assert len(recording.frequencies_hz) == len(recording.amplitude) == len(result.amplitude)
