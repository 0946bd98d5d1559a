import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from selection_samples import sampled_texture

from mmt.texture.selection.cache import SearchCache
from mmt.texture.selection.knocks import (
    LEAST,
    LENGTH,
    WhitenedSegments,
    _Normal,
    knock_evidence,
    learn_wave,
)
from mmt.texture.selection.outliers import BLOW, SEGMENT_KINDS, find_outliers
from mmt.texture.selection.transients import Whitening

FILTER = np.array([1.0, -0.6, 0.3])
STEPS = np.arange(LENGTH)
TABLE = np.exp(-STEPS / 30.0) * (np.sin(0.58 * STEPS) + 0.7 * np.sin(0.31 * STEPS + 1.0))


def struck(generator, amplitude, start, wave=TABLE, size=280):
    texture = lfilter([1.0], FILTER, generator.normal(size=size + 100))[100:]
    part = wave[: size - start]
    texture[start : start + len(part)] += amplitude * part
    return texture


def through(segments, variance=1.0):
    ar = np.tile(FILTER[1:], (len(segments), 1))
    return WhitenedSegments.through(segments, Whitening(ar, np.full(len(segments), variance)))


def explained(segment, wave, start, size):
    """What least squares explain of the prediction error from the wave's filtered samples."""
    error = lfilter(FILTER, 1.0, segment)[2:]
    whole = np.convolve(FILTER, wave)
    filtered = np.zeros(len(error) + 3 * LENGTH)
    filtered[LENGTH + start : LENGTH + start + len(whole)] = whole
    column = filtered[LENGTH : LENGTH + size]
    return (column @ error) ** 2 / (column @ column), (column @ error) / (column @ column)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_the_wave_is_found_where_least_squares_explain_most(seed, variance):
    generator = np.random.default_rng(seed)
    segments = [struck(generator, 2.0, int(generator.integers(0, 200))) for _ in range(3)]
    found = through(segments, variance).find(TABLE)
    whole = np.convolve(FILTER, TABLE)
    for index, segment in enumerate(segments):
        size = len(segment) - 2
        best = (0.0, 0.0, 0)
        for start in range(-20, size - 16):
            window = whole[max(0, -start) : max(0, size - start)]
            if window @ window > 0.2 * (whole @ whole):
                energy, amplitude = explained(segment, TABLE, start, size)
                best = max(best, (energy / variance, amplitude / np.sqrt(variance), start))
        assert found.energy[index] == pytest.approx(best[0], rel=1e-6)
        assert found.amplitude[index] == pytest.approx(best[1], rel=1e-6)
        assert found.onset[index] == best[2]


def errors_of(heard, index):
    """Undo the filter in reversed time."""
    size = heard.length[index]
    return lfilter([1.0], FILTER, heard.back[index, 2 : 2 + size][::-1])[::-1]


def likeness_of(a, b):
    product = np.abs(np.correlate(a, b, "full")).max()
    return product / np.sqrt((a @ a) * (b @ b))


@pytest.fixture(scope="module")
def table():
    """Twelve blows on one table, ten each of its own, and texture alone."""
    generator = np.random.default_rng(5)
    same = [struck(generator, 3.0, int(generator.integers(0, 180))) for _ in range(12)]
    others = []
    for _ in range(10):
        wave = np.exp(-STEPS / 20.0) * np.sin(generator.uniform(0.9, 2.5) * STEPS)
        others.append(struck(generator, 3.0, int(generator.integers(0, 180)), wave))
    return through([*same, *others, *(struck(generator, 0.0, 0) for _ in range(60))])


def test_the_wave_of_the_table_is_learnt_though_others_were_struck_too(table):
    accused = np.arange(22)
    rings = table.subset(accused).find(TABLE).energy
    rings[12:] = 120.0
    blow = learn_wave(table.subset(accused), rings)
    assert likeness_of(blow.wave, TABLE) > 0.9
    warm = learn_wave(table.subset(accused), rings, blow.wave)
    assert likeness_of(warm.wave, blow.wave) > 0.99


def test_a_blow_that_was_not_accused_stands_out_and_nobody_vouches_for_himself(table):
    accused = np.arange(len(table.length)) < 22
    accused[11] = False
    rings = np.full(21, 60.0)
    blow = learn_wave(table.subset(np.flatnonzero(accused)), rings)
    evidence = knock_evidence(table, accused, blow)
    assert evidence[11] > evidence[22:].max()
    assert np.median(evidence[:11]) > evidence[22:].max()
    assert np.median(evidence[12:22]) < np.median(evidence[:11])


def test_the_wave_is_that_of_least_squares_and_the_others_is_it_without_ones_own(table):
    normal = _Normal(table)
    found = table.find(TABLE)
    counts = np.random.default_rng(7).uniform(0.1, 1.0, len(table.length))
    wave, others = normal.solve(found, counts)
    falling = np.exp(-2.0 * STEPS / 80.0)
    system, side = np.diag(falling.sum() / falling), np.zeros(LENGTH)
    for index, onset in enumerate(found.onset.tolist()):
        columns = np.zeros((LENGTH, 3 * LENGTH + 400))
        for step in range(LENGTH):
            columns[step, LENGTH + onset + step : LENGTH + onset + step + 3] = FILTER
        inside = columns[:, LENGTH : LENGTH + table.length[index]] * found.amplitude[index]
        system += counts[index] * inside @ inside.T
        side += counts[index] * inside @ errors_of(table, index)
    expected = np.linalg.solve(system, side)
    assert np.abs(wave - expected).max() < 0.05 * np.abs(expected).max()  # the segments' ends
    counts[3] = 0.0
    np.testing.assert_allclose(normal.solve(found, counts)[0], others[3], atol=1e-12)


def test_segments_too_short_silent_or_all_the_same_do_no_harm():
    generator = np.random.default_rng(6)
    segments = [np.zeros(300), np.zeros(0), np.ones(20), *[struck(generator, 1.0, 10)] * 9]
    heard = through(segments)
    accused = np.arange(len(segments)) > 1
    blow = learn_wave(heard.subset(np.flatnonzero(accused)), np.zeros(10))
    evidence = knock_evidence(heard, accused, blow)
    assert np.isfinite(evidence).all()
    assert not evidence[1:3].any()


@pytest.mark.parametrize("factor", [1e-100, 1e-6, 1e6, 1e100])
def test_one_segment_of_another_loudness_does_not_take_the_wave_from_the_others(table, factor):
    accused = np.arange(22)
    heard = table.subset(accused)
    rings = heard.find(TABLE).energy
    rings[12:] = 120.0
    scale = np.ones(22)
    scale[15] = factor
    scaled = heard._replace(
        square=heard.square * scale**2,
        back=heard.back * scale[:, None],
        spectrum=heard.spectrum * scale[:, None],
    )
    blow = learn_wave(scaled, rings * scale**2)
    assert likeness_of(blow.wave, TABLE) > 0.9
    assert np.isfinite(blow.others).all()


def test_the_blow_counts_once_there_are_enough_outliers():
    data, knocked = sampled_texture(160, 2, knocks=16, seed=1)
    found = find_outliers(data)
    assert found.evidence.kinds == (*SEGMENT_KINDS, BLOW)
    assert found.outlier[knocked].mean() >= 0.9
    few, _ = sampled_texture(60, 2, knocks=2, seed=1)
    assert find_outliers(few).evidence.kinds == SEGMENT_KINDS


def test_a_wave_is_remembered_until_there_are_many_more_outliers():
    memory = SearchCache()
    assert memory.wave(LEAST) is None
    memory.put_wave(TABLE, 8)
    memory.put_wave(TABLE + 1.0, 9)
    np.testing.assert_array_equal(memory.wave(9), TABLE + 1.0)
    assert memory.wave(10) is None
