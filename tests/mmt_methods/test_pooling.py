"""Samples of several trials in one, and what a selection of them costs, against plain oracles."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator
from scipy.signal import freqz, lfilter

from mmt.core.errors import InputError, MmtError
from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.session.files import write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.space import InputSpace, TextureSamples
from mmt_methods.selection import ModelPoints
from mmt_methods.selection.points import band
from mmt_methods.selection.pooling import is_model, left_out_errors, pool_models, pool_sessions

ORDER = 6
SETTINGS = ModellingSettings(order=ORDER)


def taps(lsf):
    return np.append(1.0, lsf_to_ar(lsf))


def amplitude(row):
    """The amplitude spectrum of a row of frequencies and a variance."""
    _, response = freqz(1.0, taps(row[:-1]), worN=2.0 * np.pi * band())
    return np.sqrt(row[-1]) * np.abs(response)


def drawn(count, seed):
    random = np.random.default_rng(seed)
    even = np.pi * np.arange(1, ORDER + 1) / (ORDER + 1)
    lsf = even + random.uniform(-0.15, 0.15, (count, ORDER))
    return ModelPoints(random.random((count, 2)), lsf, random.uniform(0.2, 5.0, count))


@pytest.mark.parametrize("seed", range(5))
def test_errors_are_those_at_left_out_places_interpolated_one_by_one(seed):
    data, random = drawn(40, seed), np.random.default_rng(seed)
    outlier = random.random(40) < 0.1
    kept = ~outlier & (random.random(40) < 0.6)
    rows = np.column_stack([data.lsf, data.variance])

    def at(place, used):
        others = used & (np.arange(40) != place)
        return LinearNDInterpolator(data.points[others], rows[others])(data.points[place])[0]

    found = left_out_errors(data, outlier, kept)
    figures = {"before": [], "after": []}
    for place in np.flatnonzero(~outlier).tolist():
        before, after = at(place, np.ones(40, bool)), at(place, kept)
        if np.isnan(before + after).any():
            continue
        truth = amplitude(rows[place])
        for name, row in (("before", before), ("after", after)):
            guess = amplitude(row)
            error = np.linalg.norm(guess - truth) / np.linalg.norm(truth)
            gfc = guess @ truth / np.linalg.norm(guess) / np.linalg.norm(truth)
            level_db = 10 * np.log10((guess @ guess) / (truth @ truth))
            figures[name].append((error, gfc, level_db))
    assert found["places"] == len(figures["before"]) > 5
    for name, values in figures.items():
        error, gfc, level_db = np.array(values).T
        expected = {
            "spectral_error": error.mean(),
            "gfc": gfc.mean(),
            "power_error_db": np.sqrt(np.mean(level_db**2)),
        }
        assert found[name] == pytest.approx(expected, rel=1e-9)


def test_where_no_place_can_be_asked_there_are_no_errors():
    data = drawn(3, 0)  # a triangle: no place lies among the others
    nothing, everything = np.zeros(3, bool), np.ones(3, bool)
    assert left_out_errors(data, nothing, everything) == {"places": 0}


@pytest.fixture(scope="module")
def sessions():
    return [
        RecordedSession(
            simulate_session(Scene(), surface="wood", duration_s=4.0, seed=seed)[0],
            path=Path(f"{seed}.mcap"),
        )
        for seed in (1, 2)
    ]


def test_sessions_are_pooled_one_after_the_other(sessions):
    single = [pool_sessions([session], SETTINGS) for session in sessions]
    both = pool_sessions(sessions, SETTINGS)
    for name in ("inputs", "lsf", "variance", "power"):
        parts = [getattr(pool.samples, name) for pool in single]
        np.testing.assert_array_equal(getattr(both.samples, name), np.concatenate(parts))
    assert both.origin == single[0].origin + single[1].origin
    assert set(both.origin) == {"1.mcap", "2.mcap"}


def test_a_pools_samples_are_those_of_their_segments(sessions):
    pool = pool_sessions(sessions, replace(SETTINGS, method="published"))
    assert pool.data.segments is not None
    samples = pool.samples
    assert len(samples) == len(pool.data.segments) > 10
    for row, segment in enumerate(pool.data.segments):
        assert samples.power[row] == pytest.approx(np.mean(np.square(segment)))
        error = lfilter(taps(samples.lsf[row]), [1.0], segment)[ORDER:]
        assert samples.variance[row] == pytest.approx(np.mean(error**2), rel=0.1)
    np.testing.assert_allclose(pool.data.points, samples.inputs / (300.0, 3.0))
    kept = np.arange(len(samples)) % 2 == 0
    model = pool.model(kept)
    assert (model.method, model.rate_hz) == ("published", 1000.0)
    np.testing.assert_array_equal(model.samples.inputs, samples.inputs[kept])
    assert pool_sessions(sessions, ModellingSettings()).samples.lsf.shape[1] >= 2


def test_without_a_steady_stroke_there_is_nothing_to_pool(sessions):
    silent = sessions[0].frames.copy()
    silent["acceleration_m_s2"] = 9.81
    still = sessions[0].frames.copy()
    still["position_mm"] = 0.0
    for frames in (silent, still):
        with pytest.raises(MmtError, match="too few steady strokes"):
            pool_sessions([RecordedSession(frames)], SETTINGS)


def model_of(order=ORDER, rate_hz=1000.0, inputs="isotropic"):
    points, space = drawn(12, order), InputSpace(inputs)
    speed, force = points.points.T
    places = np.column_stack([speed] * (space.dimensions - 1) + [force])
    lsf = points.lsf[:, :order]
    power = 2.0 * points.variance
    samples = TextureSamples(places * space.scale, lsf, points.variance, power, space)
    return TextureModel(samples, rate_hz=rate_hz)


def test_models_are_pooled_one_after_the_other():
    first, second = model_of(), model_of()
    second = TextureModel(replace(second.samples, power=3.0 * second.samples.power))
    pool = pool_models([first, second], ["a", "b"])
    for name in ("inputs", "lsf", "variance", "power"):
        parts = [getattr(model.samples, name) for model in (first, second)]
        np.testing.assert_array_equal(getattr(pool.samples, name), np.concatenate(parts))
    assert pool.origin == ("a",) * 12 + ("b",) * 12
    assert pool.data.segments is None
    assert (pool.settings.method, pool.settings.rate_hz) == ("field", 1000.0)


@pytest.mark.parametrize(
    ("other", "what"),
    [
        ({"order": 4}, "its order is 4, that of a 6"),
        ({"rate_hz": 800.0}, r"its rate is 800\.0, that of a 1000\.0"),
        ({"inputs": "anisotropic"}, "its inputs is .*anisotropic"),
    ],
)
def test_models_that_disagree_are_refused(other, what):
    with pytest.raises(InputError, match=f"model b: {what}"):
        pool_models([model_of(), model_of(**other)], ["a", "b"])


def test_a_model_is_told_from_a_session_by_its_content(tmp_path, sessions):
    model_of().save(tmp_path / "model.npz")
    np.savez(tmp_path / "session.npz", time_s=np.arange(3.0))
    write_session(tmp_path / "session.mcap", sessions[0].frames)
    assert is_model(tmp_path / "model.npz")
    assert not is_model(tmp_path / "session.npz")
    assert not is_model(tmp_path / "session.mcap")
    (tmp_path / "broken.npz").write_bytes(b"none")
    for name in ("broken.npz", "absent.npz"):
        with pytest.raises(InputError, match=name):
            is_model(tmp_path / name)
