"""Blocks, and what is known of a surface."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from surface_samples import BLOCK, PEAKED, SMOOTH, make_blocks

from mmt.texture.field.covariance import Between, settings
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.surfaces import BlockCutter, KnownSurface, SurfaceBlock
from mmt.texture.surfaces.bands import spectrum_components
from mmt.texture.surfaces.blocks import AUDIBLE, coordinates_of
from mmt.texture.surfaces.cells import LARGEST, SurfaceCells
from mmt.texture.surfaces.posterior import SETTINGS, SurfacePosterior
from mmt.texture.surfaces.prior import CONSTANTS, NUGGET, SILL, SIZES
from mmt.texture.surfaces.surface import KNOCK, Felt


def stream(
    count: int, *, speed: float = 100.0, force: float = 1.0, first: int = 0, rms: float = 1.0
) -> AlignedBlock:
    """Return aligned samples of a steady stroke."""
    index = np.arange(first, first + count)
    vibration = rms * np.random.default_rng(first).standard_normal((count, 1))
    return AlignedBlock(
        index=index,
        time_ns=index * 1_000_000,
        position_mm=np.zeros((count, 3)),
        velocity_mm_s=np.tile([0.0, speed], (count, 1)),
        speed_mm_s=np.full(count, speed),
        normal_force_n=np.full(count, force),
        vibration_m_s2=vibration,
        valid=np.ones(count, dtype=np.bool_),
        measured=np.ones(count, np.bool_),
    )


def cutter() -> BlockCutter:
    return BlockCutter(ModellingSettings())


# --- blocks


def test_the_cut_into_updates_does_not_matter() -> None:
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


def test_the_next_contact_is_a_touchdown() -> None:
    parts = cutter()
    first = parts.cut(stream(200))
    assert [b.touchdown for b in first] == [True] + [False] * (len(first) - 1)
    parts.cut(stream(100, force=0.0, first=200))
    again = parts.cut(stream(230, first=310))
    assert again[0].touchdown
    assert {block.contact_start for block in again} == {310}


def test_what_is_but_noise_of_the_sensor_is_in_no_block() -> None:
    parts = cutter()
    parts.cut(stream(500, force=0.0, rms=0.1))
    assert parts.cut(stream(500, first=500, rms=0.1 * np.sqrt(0.5 * AUDIBLE))) == []
    assert len(parts.cut(stream(500, first=1000, rms=0.1 * np.sqrt(2.0 * AUDIBLE)))) > 5


def test_a_louder_block_differs_in_its_level_alone() -> None:
    vibration = np.random.default_rng(2).standard_normal((4, BLOCK, 1))
    apart = spectrum_components(2.0 * vibration) - spectrum_components(vibration)
    np.testing.assert_allclose(apart[:, 0], np.log(4.0))
    np.testing.assert_allclose(apart[:, 1:], 0.0, atol=1e-12)


def test_the_scatter_of_white_noise_is_what_is_assumed() -> None:
    values = spectrum_components(np.random.default_rng(1).standard_normal((8000, BLOCK, 1)))
    np.testing.assert_allclose(values.var(axis=0), NUGGET, rtol=0.15)


def test_silence_has_a_finite_spectrum() -> None:
    assert np.isfinite(spectrum_components(np.zeros((1, BLOCK, 1)))).all()


# --- how a surface scatters


def scattered(patch: float, count: int, seed: int) -> list[SurfaceBlock]:
    """Return blocks of one stroke of 8 blocks after another whose levels differ by stroke."""
    random = np.random.default_rng(seed)
    template = make_blocks(SMOOTH, 1, 0)[0]
    found = []
    for number in range(count):
        if number % 8 == 0:
            offset = patch * random.standard_normal()
        values = 0.3 * random.standard_normal(6) + offset
        start = 1000 * (number // 8) + BLOCK * (number % 8)
        found.append(replace(template, start=start, stop=start + BLOCK, values=values))
    return found


@pytest.mark.parametrize("patch", [0.0, 0.6])
def test_the_scatter_is_learned_from_the_surface_itself(patch: float) -> None:
    cells = SurfaceCells(directed=False)
    for start in range(0, 1600, 8):
        cells.add(scattered(patch, 1600, 3)[start : start + 8])
    np.testing.assert_allclose(cells.nugget, 0.09, rtol=0.15)
    np.testing.assert_allclose(cells.sill, patch**2 + SILL, rtol=0.4, atol=0.012)


def test_headings_on_both_sides_of_the_half_turn_are_one_cell_there() -> None:
    cells = SurfaceCells(directed=True)
    for heading in (np.pi - 0.1, 0.1 - np.pi):
        cells.add(make_blocks(SMOOTH, 1, 3, heading=heading))
    assert len(cells) == 1
    assert np.cos(cells.centres.heading[0]) == pytest.approx(-1.0)


def test_cells_are_bounded_in_number() -> None:
    cells = SurfaceCells(directed=True)
    for seed in range(60):
        cells.add(make_blocks(SMOOTH, 16, seed, heading=0.1 * seed, low=(0.0, 0.0)))
    assert len(cells) == LARGEST


# --- predictions


def test_an_unknown_surface_is_predicted_by_the_prior() -> None:
    """By an independent oracle: scipy's normal density of all blocks of a component at once."""
    blocks = make_blocks(PEAKED, 5, 1)
    posterior = SurfacePosterior(SurfaceCells(directed=False))
    posterior._weights = np.zeros((SETTINGS, 6))
    posterior._weights[2] = 1.0
    found = posterior.innovations(blocks)
    at = coordinates_of(np.array([block.stroke for block in blocks]))
    prior = Between(at, at, directed=False).covariance(
        settings(SETTINGS, directed=False, rough=False)[2], constant=0.0
    )
    scatter = posterior._scatter(np.array([block.position_mm for block in blocks]), at)
    for k in range(6):
        covariance = SIZES[k] ** 2 * prior + CONSTANTS[k] ** 2 + scatter[k]
        expected = multivariate_normal(np.zeros(5), covariance).logpdf(
            [b.values[k] for b in blocks]
        )
        z, deviation = found.standardised[:, k], found.deviation[:, k]
        density = np.sum(-0.5 * z**2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi))
        assert density == pytest.approx(expected)


def learned(surface: KnownSurface, blocks: list[SurfaceBlock]) -> KnownSurface:
    for start in range(0, len(blocks), 10):
        part = blocks[start : start + 10]
        found, densities = surface._posterior.innovations(part), surface.log_densities(part)
        surface.learn([Felt(*one) for one in zip(part, *found, densities, strict=True)])
    return surface


def test_innovations_of_a_surface_are_standardised_and_those_of_another_are_not() -> None:
    surface = learned(KnownSurface(directed=False), make_blocks(SMOOTH, 300, 3))
    own, other = make_blocks(SMOOTH, 30, 4), make_blocks(PEAKED, 30, 5)
    assert 0.6 < np.square(surface._posterior.innovations(own).standardised).mean() < 1.5
    assert np.square(surface._posterior.innovations(other).standardised).mean() > 3.0
    assert surface.log_densities(own).sum() > surface.log_densities(other).sum() + 50.0


def test_a_surface_is_known_where_it_was_touched_and_less_far_from_there() -> None:
    blocks = make_blocks(SMOOTH, 60, 3, low=(0.3, 0.3), high=(0.5, 0.5))
    surface = learned(KnownSurface(directed=False), blocks)._posterior
    near, far = (
        surface.innovations(make_blocks(SMOOTH, 1, 9, low=at, high=at)).deviation[0]
        for at in ((0.4, 0.4), (1.0, 0.05))
    )
    unknown = SurfacePosterior(SurfaceCells(directed=False)).innovations(blocks[:1]).deviation[0]
    assert (near[:2] < far[:2]).all()
    assert (far < unknown).all()


def test_a_knock_is_not_learned() -> None:
    """The prediction moves by no more than by a block five deviations off."""
    blocks = make_blocks(SMOOTH, 100, 3, low=(0.4, 0.4), high=(0.4, 0.4))
    surface = learned(KnownSurface(directed=False), blocks)
    (block,) = make_blocks(SMOOTH, 1, 4, low=(0.4, 0.4), high=(0.4, 0.4), first=200)
    knock = surface.newest([replace(block, values=block.values + 30.0)], surface.explained([block]))
    np.testing.assert_allclose(knock.standardised > KNOCK, True)
    off = (knock.tamed.values - block.values) / knock.deviation
    np.testing.assert_allclose(off, KNOCK, atol=4.0)
    surface.learn([knock])
    assert np.square(surface._posterior.innovations([block]).standardised).mean() < 3.0


@pytest.mark.parametrize("turning", [False, True])
def test_a_heading_never_touched_is_less_known_where_others_differ(turning: bool) -> None:
    blocks = []
    for number in range(30):
        heading = 0.1 * (number % 6)
        for block in make_blocks(SMOOTH, 4, number, heading=heading, first=4 * number):
            change = 2.0 * np.cos(4.0 * heading) if turning else 0.0
            blocks.append(replace(block, values=block.values + change))
    surface = learned(KnownSurface(directed=True), blocks)._posterior
    there, across = (
        surface.innovations(make_blocks(SMOOTH, 1, 9, heading=heading)).deviation[0, 0]
        for heading in (0.2, 1.6)
    )
    assert across > (1.3 if turning else 1.0) * there


def test_what_is_felt_is_finite_whatever_was_learned() -> None:
    random = np.random.default_rng(5)
    for scale in (1e-6, 1.0, 30.0):
        blocks = [
            replace(block, values=scale * random.standard_normal(6))
            for block in make_blocks(SMOOTH, 60, 1)
        ]
        surface = learned(KnownSurface(directed=False), blocks)
        assert np.isfinite(surface.log_densities(make_blocks(PEAKED, 20, 2))).all()
