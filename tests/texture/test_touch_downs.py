"""Touch-downs: found in a stream, fitted, kept in a file, and rendered."""

import math
from dataclasses import astuple, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import periodogram
from stream_samples import aligned

import mmt
from mmt.core.errors import InputError
from mmt.scene.files import scene_from_tables
from mmt.texture.model.texture_model import TextureModel, load_model
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt.texture.touch_down.fitting import (
    LEAST,
    TouchDown,
    TouchDownFinder,
    fit_transient,
    held_out_errors,
)
from mmt.texture.touch_down.transient import Law

K = 5
RATE_HZ = 1000.0 * K
SETTINGS = ModellingSettings(samples_per_frame=K)
PERIOD = 500
"""Frames from one touch-down to the next: 200 in the air, 300 in contact."""


def ring(speed_mm_s, count=50 * K, rate_hz=RATE_HZ):
    """A transient that is proportional to the speed, and higher the faster."""
    time_s = np.arange(count) / rate_hz
    frequency_hz = 150.0 + speed_mm_s
    wave = np.exp(-time_s / 0.006) * np.sin(2.0 * np.pi * frequency_hz * time_s)
    return np.asarray(0.1 * speed_mm_s * wave)


def landings(speeds_mm_s, noise=0.0, axes=1):
    """A stream in which the tool comes down at each speed in turn."""
    count = PERIOD * len(speeds_mm_s)
    force, place = np.zeros(count), np.zeros((count, 3))
    vibration = noise * np.random.default_rng(1).standard_normal((count * K, axes))
    for number, speed in enumerate(speeds_mm_s):
        at = PERIOD * number + 200
        place[at - 200 : at, 2] = speed * np.arange(200, 0, -1) / 1000.0
        force[at : at + 300] = 1.0
        vibration[at * K : (at + 50) * K, -1] += ring(speed)
    return aligned(vibration.reshape(count, K, axes), position_mm=place, normal_force_n=force)


def found(block, chosen=SETTINGS):
    return TouchDownFinder(chosen).update(block)


SPEEDS = [20.0, 150.0, 35.0, 60.0, 100.0, 80.0]


def learnt(speeds=None):
    transient = fit_transient(found(landings(speeds or SPEEDS)), RATE_HZ)
    assert transient is not None
    return transient


@pytest.mark.parametrize("axes", [1, 3])
def test_each_is_found_where_it_is_with_its_speed_and_energy(axes):
    chosen = replace(SETTINGS, axis="z" if axes == 1 else "dft321")
    all_of_them = found(landings(SPEEDS, axes=axes), chosen)
    assert [each.frame for each in all_of_them] == [PERIOD * n + 200 for n in range(len(SPEEDS))]
    np.testing.assert_allclose([each.speed_mm_s for each in all_of_them], SPEEDS, rtol=1e-6)
    wanted = [np.square(ring(speed)).sum() / RATE_HZ for speed in SPEEDS]
    np.testing.assert_allclose([each.energy for each in all_of_them], wanted, rtol=0.02)


@given(cuts=st.lists(st.integers(0, PERIOD * len(SPEEDS)), max_size=12))
@settings(max_examples=40)
def test_how_the_stream_comes_in_parts_changes_nothing(cuts):
    block = landings(SPEEDS, noise=0.1)
    finder, edges = TouchDownFinder(SETTINGS), [0, *sorted(cuts), len(block)]
    parts = [block[a:b] for a, b in pairwise(edges)]
    in_parts = [each for part in parts for each in finder.update(part)]
    for one, other in zip(in_parts, found(block), strict=True):
        np.testing.assert_equal(astuple(one), astuple(other))


def test_texture_and_noise_that_go_on_are_taken_off_the_energy():
    wanted = [np.square(ring(speed)).sum() / RATE_HZ for speed in SPEEDS]
    energies = {t.frame: t.energy for t in found(landings(SPEEDS, noise=0.3))}
    assert len(energies) >= 5
    for frame, energy in energies.items():
        assert energy == pytest.approx(wanted[frame // PERIOD], rel=0.15)


@pytest.mark.parametrize(
    "spoiled",
    ["not valid", "not measured", "gap", "no quiet time", "soft", "upwards", "shaken before"],
)
def test_what_is_no_clean_touch_down_is_left_out(spoiled):
    block = landings([50.0, 60.0])
    if spoiled == "not valid":
        block.valid[220] = False
    elif spoiled == "not measured":
        block.measured[180] = False
    elif spoiled == "gap":
        block = block[np.arange(len(block)) != 210]
    elif spoiled == "no quiet time":
        block.normal_force_n[150] = 1.0
    elif spoiled == "soft":
        block.vibration_m_s2[200:500] = 0.2
    elif spoiled == "upwards":
        block.position_mm[:200] *= -1.0
    else:
        block.vibration_m_s2[140:190] = 5.0
    assert [each.frame for each in found(block)] == [PERIOD + 200]


def test_nothing_is_found_in_the_air_or_in_a_stroke():
    block = landings(SPEEDS)
    for force in (0.0, 1.0):
        assert not found(replace(block, normal_force_n=np.full(len(block), force)))
    assert not found(AlignedBlock.empty())


def test_too_few_teach_nothing():
    few = found(landings(SPEEDS[: LEAST - 1]))
    assert fit_transient(few, RATE_HZ) is None
    assert fit_transient([], RATE_HZ) is None
    assert held_out_errors(found(landings(SPEEDS[:LEAST])), RATE_HZ) is None
    assert held_out_errors([], RATE_HZ) is None


@given(exponent=st.floats(0.1, 1.4), level=st.floats(1e-3, 1e3), seed=st.integers(0, 99))
@settings(max_examples=30)
def test_the_law_is_that_of_an_independent_estimator(exponent, level, seed):
    generator = np.random.default_rng(seed)
    speeds = 10.0 * 1.6 ** np.arange(7)  # all pairs tell of the exponent
    roots = level * (speeds / 100.0) ** exponent * np.exp(0.1 * generator.standard_normal(7))
    each = [
        TouchDown(n, float(v), ring(float(v)), float(root**2))
        for n, (v, root) in enumerate(zip(speeds, roots, strict=True))
    ]
    transient = fit_transient([each[place] for place in generator.permutation(7)], RATE_HZ)
    slope = stats.theilslopes(np.log(roots), np.log(speeds)).slope
    left = np.log(roots) - slope * np.log(speeds / 100.0)
    assert transient.law.exponent == pytest.approx(min(max(slope, 0.0), 1.5), abs=1e-9)
    if 0.0 < slope < 1.5:
        assert transient.law.amplitude == pytest.approx(math.exp(np.median(left)))
        scatter = 20.0 / math.log(10.0) * stats.median_abs_deviation(left, scale="normal")
        assert transient.law.error_db == pytest.approx(scatter, rel=1e-3)


def test_the_most_typical_of_each_group_stands_for_it():
    transient = learnt()
    each = sorted(found(landings(SPEEDS)), key=lambda t: t.speed_mm_s)
    assert len(transient.shapes) == 2
    for shape, group in zip(transient.shapes, (each[:3], each[3:]), strict=True):
        scaled = [t.vibration_m_s2 / math.sqrt(np.square(t.vibration_m_s2).sum()) for t in group]
        bands = [[] for _ in group]
        for place, window in enumerate(scaled):
            frequencies, density = periodogram(window, RATE_HZ, "boxcar", 2048, detrend=False)
            edges = np.geomspace(20.0, RATE_HZ / 2, 13)
            inside = [(frequencies >= a) & (frequencies < b) for a, b in pairwise(edges)]
            bands[place] = [10 * math.log10(density[where].sum()) for where in inside]
        away = [sum(math.dist(a, b) for b in bands) for a in bands]
        typical = scaled[int(np.argmin(away))]
        np.testing.assert_allclose(shape, typical * math.sqrt(RATE_HZ), atol=1e-12)


@given(factor=st.floats(1e-4, 1e4))
@settings(max_examples=20)
def test_a_louder_session_renders_as_much_louder(factor):
    block = landings(SPEEDS)
    louder = replace(block, vibration_m_s2=factor * block.vibration_m_s2)
    transient = fit_transient(found(louder), RATE_HZ)
    wanted = factor * learnt().response(70.0)
    np.testing.assert_allclose(transient.response(70.0), wanted, rtol=1e-6, atol=1e-9 * factor)


@pytest.mark.parametrize("size", [1e-200, 1e-6, 1e6])
def test_tiny_and_huge_ones_give_finite_numbers_or_none(size):
    block = landings(SPEEDS)
    transient = fit_transient(
        found(replace(block, vibration_m_s2=size * block.vibration_m_s2)), RATE_HZ
    )
    assert (transient is None) == (size < 1e-100)
    for speed in (-1.0, 0.0, 1e-300, 50.0, 1e300, math.nan, math.inf):
        assert transient is None or np.isfinite(transient.response(speed)).all()


@pytest.mark.parametrize("place", range(8))
def test_one_bad_touch_down_changes_little(place):
    speeds = [30.0, 45.0, 50.0, 60.0, 70.0, 90.0, 110.0, 140.0]
    each = found(landings(speeds))
    clean = fit_transient(each, RATE_HZ)
    bad = each[place]
    knock = np.random.default_rng(place).standard_normal(len(bad.vibration_m_s2))
    each[place] = replace(bad, vibration_m_s2=40.0 * knock, energy=1000.0 * bad.energy)
    spoiled = fit_transient(each, RATE_HZ)
    assert clean is not None
    assert spoiled is not None
    for speed in (40.0, 80.0, 130.0):
        one, other = (np.square(t.response(speed)).sum() for t in (clean, spoiled))
        assert abs(10.0 * math.log10(other / one)) < 1.5
        peak = np.abs(np.fft.rfft(spoiled.response(speed))).argmax() * RATE_HZ / (50 * K)
        assert 150.0 < peak < 320.0


def test_it_is_louder_the_faster_within_what_was_learnt():
    transient = learnt()

    def root(speed):
        return math.sqrt(np.square(transient.response(speed)).sum() / RATE_HZ)

    assert transient.law.exponent == pytest.approx(1.0, abs=0.1)
    assert root(10.0) == pytest.approx(0.5 * root(20.0))
    assert root(20.0) < root(60.0) < root(150.0) == pytest.approx(root(1000.0))
    assert root(0.0) == root(-5.0) == root(math.nan) == 0.0


def test_held_out_errors_are_those_of_leaving_each_out():
    each = found(landings(SPEEDS))
    errors = held_out_errors(each, RATE_HZ)
    assert errors.count == len(SPEEDS)
    assert errors.energy_db < 4.0  # the slowest and the fastest are beyond the others
    doubled = [replace(t, energy=4.0 * t.energy) if n == 2 else t for n, t in enumerate(each)]
    worse = held_out_errors(doubled, RATE_HZ)
    assert worse.energy_db > errors.energy_db + 0.4
    assert f"{errors.count} touch-downs" in errors.sentence


@cache
def felt():
    return load_model("felt").at_rate(RATE_HZ)


def with_transient(transient):
    return TextureModel(**{**felt().contents._asdict(), "touch_down": transient})


def test_a_file_keeps_it_and_one_without_it_names_nothing():
    model = with_transient(learnt())
    again = TextureModel.from_bytes(model.to_bytes())
    assert again.to_bytes() == model.to_bytes()
    assert again.touch_down.law == model.touch_down.law
    np.testing.assert_array_equal(again.touch_down.shapes, model.touch_down.shapes)
    bare = with_transient(None)
    assert b"touch_down" not in bare.to_bytes()
    assert bare.to_bytes() == felt().to_bytes()


@pytest.mark.parametrize(
    "changed",
    [
        {"speeds_mm_s": np.array([1.0])},
        {"speeds_mm_s": np.array([2.0, 1.0])},
        {"speeds_mm_s": np.array([0.0, 1.0])},
        {"shapes": np.full((2, 5), np.nan)},
        {"shapes": np.zeros((2, 0))},
        {"shapes": np.zeros((2, 50_001))},
        {"shapes": np.zeros(5)},
        *({"law": Law(*law)} for law in [(-1, 1, 1, 2, 0), (1, 2, 1, 2, 0), (1, 1, 3, 2, 0)]),
        *({"law": Law(*law)} for law in [(1, 1, 0, 2, 0), (1, 1, 1, 2, -1), (np.nan, 1, 1, 2, 0)]),
    ],
)
def test_a_broken_one_is_refused(changed):
    with pytest.raises(InputError, match="touch_down"):
        with_transient(replace(learnt(), **changed))


def test_at_another_rate_it_is_the_same_within_the_band():
    model = with_transient(learnt())
    faster, slower = model.at_rate(50_000.0), model.at_rate(1000.0)
    assert slower.touch_down is None
    assert astuple(faster.touch_down.law) == astuple(model.touch_down.law)
    np.testing.assert_allclose(
        faster.touch_down.response(80.0)[::10], model.touch_down.response(80.0), atol=1e-9
    )


def rendered(transient, speeds, block=5, limit=60.0):
    """Render a stroke of 150 ms, with touch-downs at numbers of blocks of five samples."""
    synthesizer = Synthesizer(with_transient(transient), seed=3, limit_m_s2=limit)
    parts, inputs = [], (np.full(5, 100.0), np.ones(5))
    for number in range(150):
        if number in speeds:
            synthesizer.touch_down(speeds[number])
        parts += [
            synthesizer.render(*(each[start : start + block] for each in inputs))
            for start in range(0, 5, block)
        ]
    return np.concatenate(parts)


@pytest.mark.parametrize("block", [1, 5])
def test_it_is_added_to_the_texture_however_samples_are_asked_for(block):
    transient = learnt()
    texture = rendered(None, {20: 80.0})
    wanted = texture.copy()
    for number, speed in {20: 80.0, 40: 50.0}.items():
        response = transient.response(speed)
        wanted[5 * number : 5 * number + len(response)] += response
    output = rendered(transient, {20: 80.0, 40: 50.0}, block)
    np.testing.assert_allclose(output, wanted, atol=1e-12)


def test_its_sum_is_within_the_limit():
    output = rendered(learnt(), dict.fromkeys(range(20, 30), 150.0), limit=4.0)
    assert np.abs(output).max() == 4.0


def test_a_reset_silences_it_and_without_a_model_there_is_none():
    synthesizer = mmt.Synthesizer(with_transient(learnt()))
    synthesizer.touch_down(80.0)
    synthesizer.reset()
    assert not synthesizer.render(np.zeros(50), np.zeros(50)).any()
    mmt.Synthesizer().touch_down(80.0)


@pytest.mark.parametrize("k", [2, K])
def test_from_five_kilohertz_on_a_session_teaches_them_and_its_evaluation_tells(k):
    tables = {
        "session": {"acceleration_rate_hz": 1000 * k, "seed": 2},
        "link": {},
        "simulated": {"surface": "wood", "surface_stiffness_n_mm": 20.0},
        "texture": {},
        "hand": {"kind": "taps"},
    }
    frames, truth = mmt.simulate_session(scene_from_tables(tables), duration_s=7.0)
    result = mmt.evaluate_session(mmt.RecordedSession(frames, annotations=truth))
    model, told = result.model_at(7.0), result.as_dict()["touch_downs"]
    assert model is not None
    if k < K:
        assert model.touch_down is told is None
        assert "touch-downs" not in result.remark
        return
    assert model.touch_down is not None
    assert told["count"] >= 5
    assert told["energy_db"] < 5.0
    assert "touch-downs" in result.remark
