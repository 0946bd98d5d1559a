"""Surfaces made rough, patchy and bursty, and textures drawn at random: the truth stays exact."""

import numpy as np
import pytest
from known_surface_samples import realisation

from mmt.core.errors import InputError
from mmt.testing.simulation.strokes import REACH_MM
from mmt.testing.simulation.surfaces.alterations import Level, Patches
from mmt.testing.simulation.surfaces.altered_surface import AlteredSurface
from mmt.testing.simulation.surfaces.drawn_textures import FINAL, draw_texture
from mmt.testing.simulation.surfaces.known_surfaces import Stroke
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt_lab.harness.experiment import DRAWN, chosen_textures

FAST = Stroke(120.0, 1.2)


@pytest.mark.parametrize(("deviation_db", "seed"), [(3.0, 1), (3.0, 2), (5.0, 3)])
def test_patches_have_the_deviation_mean_power_and_size_stated(deviation_db, seed):
    gains = np.array(Patches(deviation_db, seed).gains())
    away = np.minimum(np.arange(len(gains)) + 0.5, len(gains) - np.arange(len(gains)) - 0.5)
    near = np.hypot(away[:, None], away[None, :]) < REACH_MM
    assert (20.0 * np.log10(gains))[near].std() == pytest.approx(deviation_db, rel=1e-9)
    assert (gains[near] ** 2).mean() == pytest.approx(1.0, rel=1e-9)
    across_mm = np.sqrt(4.0 / np.pi * np.unique(gains, return_counts=True)[1])
    assert np.mean((across_mm > 12.0) & (across_mm < 30.0)) > 0.95


def test_a_patch_stays_where_it_is_and_the_power_over_all_is_the_truth():
    surface = get_surface("sandpaper+patches")
    gains = np.array(surface.patches.gains())
    source = surface.vibration(np.random.default_rng(2))
    spots = np.random.default_rng(5).uniform(-60.0, 60.0, (150, 2))
    spots = spots[np.hypot(*spots.T) < REACH_MM]
    rows = [
        [source.step(Stroke(100.0, 1.0, position_mm=tuple(p)))[0] for _ in range(500)]
        for p in spots
    ]
    measured = np.var(np.array(rows)[:, 50:], axis=1)
    here = np.floor(spots).astype(int) % len(gains)
    expected = surface.power(100.0, 1.0)[0] * gains[here[:, 1], here[:, 0]] ** 2
    error_db = 10.0 * np.log10(measured / expected)
    assert abs(error_db.mean()) < 0.3
    assert error_db.std() < 1.2
    plain = get_surface("sandpaper").power(100.0, 1.0)
    np.testing.assert_allclose(surface.power(100.0, 1.0), plain)


@pytest.mark.parametrize("kurtosis", [4.0, 7.0])
def test_bursts_have_the_kurtosis_stated_and_leave_the_power(kurtosis):
    surface = get_surface(f"sandpaper+bursts-{kurtosis:g}")
    normal, along = realisation(surface, FAST, 250_000, seed=1).T
    power = surface.power(120.0, 1.2)[0]
    assert normal.var() == pytest.approx(power, rel=0.06)
    assert (normal**4).mean() / normal.var() ** 2 == pytest.approx(kurtosis, rel=0.17)
    assert along.var() == pytest.approx(0.09 * power, rel=0.1)
    blocks = np.log((normal[: 12 * (len(normal) // 12)].reshape(-1, 12) ** 2).mean(axis=1))
    alike = [np.corrcoef(blocks[lag:], blocks[:-lag])[0, 1] for lag in (1, 8)]
    assert alike[0] > 0.1
    assert abs(alike[1]) < 0.03


def test_a_level_steps_at_its_threshold_and_waves_elsewhere():
    level = Level(((2.0, 3.0, -1.0, 0.5),), (("speed", 100.0, 6.0), ("force", 1.0, -3.0)))
    surface = AlteredSurface("x", SURFACES["wood"], level=level)
    speed, force = np.array([80.0, 125.0, 80.0, 125.0]), np.array([0.8, 0.8, 1.3, 1.3])
    wave = 2.0 * np.cos(3.0 * np.log(speed / 100 + 0.1) - np.log(force + 0.1) + 0.5)
    expected = wave + np.array([0.0, 6.0, -3.0, 3.0])
    rise_db = 10.0 * np.log10(surface.power(speed, force) / SURFACES["wood"].power(speed, force))
    np.testing.assert_allclose(rise_db, expected, atol=0.1)


def test_seeds_for_development_and_final_ones_are_apart():
    named = [get_surface("drawn-7"), get_surface("final-7")]
    seeded = [draw_texture("x", 7), draw_texture("x", FINAL + 7)]
    powers = [t.power(90.0, 1.0, 0.0)[0] for t in (*named, *seeded)]
    assert powers[:2] == powers[2:]
    assert powers[0] != powers[1]
    with pytest.raises(InputError, match="drawn-N and final-N"):
        get_surface(f"drawn-{FINAL}")
    assert chosen_textures("drawn, wood") == [*(f"drawn-{n}" for n in range(DRAWN)), "wood"]
    assert chosen_textures("final+bursts")[-1] == f"final-{DRAWN - 1}+bursts"


def test_an_alteration_that_is_not_known_is_explained():
    assert get_surface("wood+patches-").patches.deviation_db == 3.0
    for name in ("wood+burst", "wood+bursts-2", "wood+patches-x", "wood+patches-90"):
        with pytest.raises(InputError, match=r"is not known, allowed are \+patches"):
            get_surface(name)
    with pytest.raises(InputError, match="surface is 'wod', allowed are plastic"):
        get_surface("wod+patches")
