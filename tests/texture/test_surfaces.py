"""Blocks, and what a surface's blocks let expect of others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_t
from stream_samples import aligned
from surface_samples import PEAKED, SMOOTH, make_blocks

from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.surfaces.blocks import (
    AUDIBLE,
    LARGEST,
    SurfaceBlockCutter,
    SurfaceRegression,
    features,
)


def stream(count, *, speed=100.0, force=1.0, first=0, rms=1.0):
    """Return aligned samples of a steady stroke."""
    vibration = rms * np.random.default_rng(first).standard_normal((count, 1, 1))
    motion = {"velocity_mm_s": [0.0, speed], "speed_mm_s": speed, "normal_force_n": force}
    return aligned(vibration, first, **motion)


def cutter():
    return SurfaceBlockCutter(ModellingSettings())


def test_the_cut_into_updates_does_not_matter():
    samples = AlignedBlock.concatenate(
        [
            stream(400, force=0.0, rms=0.1),
            stream(1000, first=400, rms=0.25),
            stream(330, first=1417),
        ]
    )
    whole = cutter().cut(samples)
    parts = cutter()
    cut = [parts.cut(samples[start : start + 37]) for start in range(0, len(samples), 37)]
    found = [block for part in cut for block in part]
    assert [b.start for b in found] == [b.start for b in whole] != []
    for one, other in zip(found, whole, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert (one.touchdown, one.contact_start) == (other.touchdown, other.contact_start)


def test_the_next_contact_is_a_touchdown():
    parts = cutter()
    first = parts.cut(stream(200))
    assert [b.touchdown for b in first] == [True] + [False] * (len(first) - 1)
    parts.cut(stream(100, force=0.0, first=200))
    again = parts.cut(stream(230, first=310))
    assert again[0].touchdown
    assert {block.contact_start for block in again} == {310}


def test_what_is_but_noise_of_the_sensor_is_in_no_block():
    parts = cutter()
    parts.cut(stream(500, force=0.0, rms=0.1))
    assert parts.cut(stream(500, first=500, rms=0.1 * np.sqrt(0.5 * AUDIBLE))) == []
    assert len(parts.cut(stream(500, first=1000, rms=0.1 * np.sqrt(2.0 * AUDIBLE)))) > 5


def arrays(blocks, *, directed=False):
    strokes = np.array([block.stroke for block in blocks])
    return features(strokes, directed=directed), np.array([block.values for block in blocks])


def learned(blocks):
    surface = SurfaceRegression(directed=False)
    for start in range(0, len(blocks), 10):
        surface.learn(*arrays(blocks[start : start + 10]))
    return surface


def test_the_density_is_that_of_the_conjugate_model():
    """By an independent oracle: Student's density of all blocks of a component at once."""
    rows, values = arrays(make_blocks(SMOOTH, 6, 1))
    values = 0.1 * values  # within the bounds of single blocks
    surface = SurfaceRegression(directed=False)
    prior, shape, rate = surface.covariance.copy(), surface.shape, surface.rate.copy()
    expected = sum(
        multivariate_t(
            np.zeros(6), rate[k] / shape * (np.eye(6) + rows @ prior[k] @ rows.T), df=2.0 * shape
        ).logpdf(values[:, k])
        for k in range(6)
    )
    assert surface.log_densities(rows, values).sum() == pytest.approx(expected)


def test_learned_blocks_tell_as_much_as_those_before_in_the_same_row():
    """The chain rule: blocks may be learned, or come before the others in one call."""
    rows, values = arrays(make_blocks(SMOOTH, 30, 1))
    surface = SurfaceRegression(directed=False)
    together = surface.log_densities(rows, values)[20:]
    surface.learn(rows[:20], values[:20])
    np.testing.assert_allclose(surface.log_densities(rows[20:], values[20:]), together)


@settings(max_examples=20)
@given(st.floats(min_value=1.0, max_value=1e8))
def test_a_knock_tells_and_teaches_no_more_than_a_bounded_block(size):
    at = {"low": (0.4, 0.4), "high": (0.4, 0.4)}
    blocks = make_blocks(SMOOTH, 40, 3, **at)
    (block,) = make_blocks(SMOOTH, 1, 4, **at)
    knock = replace(block, values=block.values + size)
    surface = learned(blocks)
    plain, knocked = (float(surface.log_densities(*arrays([b])).sum()) for b in (block, knock))
    assert knocked > plain - 0.5 * LARGEST**2 - 1.0
    before = surface.innovations(*arrays([block]))
    surface.learn(*arrays([knock]))
    after = surface.innovations(*arrays([block]))
    assert np.abs(after.innovation - before.innovation).max() < 0.5 * LARGEST


def test_the_heading_counts_only_if_it_is_to():
    strokes = np.array([[-1.0, -1.0, heading] for heading in (0.0, 1.5, 3.0)])
    assert np.ptp(features(strokes, directed=False), axis=0).max() == 0.0
    assert np.ptp(features(strokes, directed=True), axis=0).max() > 0.5


@settings(max_examples=30)
@given(st.sampled_from([0.0, 1e-6, 1.0, 30.0, 1e6]), st.integers(1, 40))
def test_densities_are_finite_whatever_was_learned(scale, count):
    random = np.random.default_rng(count)
    blocks = [
        replace(block, values=scale * random.standard_normal(6))
        for block in make_blocks(SMOOTH, count, 1)
    ]
    surface = learned(blocks)
    assert np.isfinite(surface.log_densities(*arrays(make_blocks(PEAKED, 20, 2)))).all()
    assert np.isfinite(surface.log_densities(*arrays(blocks))).all()
