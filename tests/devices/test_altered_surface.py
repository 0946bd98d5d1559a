"""Surfaces made rough, patchy and bursty, and textures drawn at random: the truth stays exact."""

import time

import numpy as np
import pytest
from scipy.signal import welch

import mmt
from mmt.core.errors import InputError
from mmt.session.files import write_session
from mmt.testing.simulation.strokes import REACH_MM
from mmt.testing.simulation.surfaces.alterations import Level, Patches
from mmt.testing.simulation.surfaces.altered_surface import AlteredSurface
from mmt.testing.simulation.surfaces.course import course_from_annotations
from mmt.testing.simulation.surfaces.drawn_textures import FINAL, draw_texture
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations, vibration_of
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.testing.simulation.surfaces.vibration import Stroke
from mmt_lab.harness.experiment import DRAWN, chosen_textures


def _made(surface, count, speed=120.0, force=1.2, heading=(1.0, 0.0), seed=1):
    """Return the vibration (count, 2) of a constant stroke that stays in its place."""
    source = vibration_of(surface, np.random.default_rng(seed))
    return np.array([source.step(Stroke(speed, force, heading)) for _ in range(count + 1000)])[
        1000:
    ]


def _near(side):
    away = np.minimum(np.arange(side) + 0.5, side - np.arange(side) - 0.5)
    return np.hypot(away[:, None], away[None, :]) < REACH_MM


@pytest.mark.parametrize(("deviation_db", "seed"), [(3.0, 1), (3.0, 2), (5.0, 3)])
def test_patches_have_the_deviation_mean_power_and_size_stated(deviation_db, seed):
    gains = np.array(Patches(deviation_db, seed).gains())
    near = _near(len(gains))
    assert (20.0 * np.log10(gains))[near].std() == pytest.approx(deviation_db, rel=1e-9)
    assert (gains[near] ** 2).mean() == pytest.approx(1.0, rel=1e-9)
    across_mm = np.sqrt(4.0 / np.pi * np.unique(gains, return_counts=True)[1])
    assert np.mean((across_mm > 12.0) & (across_mm < 30.0)) > 0.95


def test_a_patch_stays_where_it_is_and_the_power_over_all_is_the_truth():
    surface = get_surface("sandpaper+patches")
    gains = np.array(surface.patches.gains())
    source = vibration_of(surface, np.random.default_rng(2))
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
    np.testing.assert_allclose(
        surface.power(100.0, 1.0), get_surface("sandpaper").power(100.0, 1.0)
    )


@pytest.mark.parametrize("kurtosis", [4.0, 7.0])
def test_bursts_have_the_kurtosis_stated_and_leave_the_power(kurtosis):
    surface = get_surface(f"sandpaper+bursts-{kurtosis:g}")
    normal, along = _made(surface, 250_000).T
    power = surface.power(120.0, 1.2)[0]
    assert normal.var() == pytest.approx(power, rel=0.06)
    assert (normal**4).mean() / normal.var() ** 2 == pytest.approx(kurtosis, rel=0.17)
    assert along.var() == pytest.approx(0.09 * power, rel=0.1)
    blocks = np.log((normal[: 12 * (len(normal) // 12)].reshape(-1, 12) ** 2).mean(axis=1))
    alike = [np.corrcoef(blocks[lag:], blocks[:-lag])[0, 1] for lag in (1, 8)]
    assert alike[0] > 0.1
    assert abs(alike[1]) < 0.03


def test_a_line_is_as_wide_as_its_bursts_make_it():
    plain, bursty = get_surface("mesh"), get_surface("mesh+bursts-8")
    frequencies, measured = welch(_made(bursty, 200_000)[:, 0], 1000, nperseg=4000)
    band = slice(60, 1000)
    truths = [s.spectrum(120.0, 1.2, frequencies[band])[0] for s in (plain, bursty)]
    errors = [np.abs(10.0 * np.log10(measured[band] / truth)) for truth in truths]
    assert np.median(errors[1]) < 1.1  # what Welch's estimate of 99 windows scatters by
    assert np.percentile(errors[0], 95) > 1.5 * np.percentile(errors[1], 95)
    fine = np.linspace(0.0, 500.0, 8001)
    total = np.trapezoid(bursty.spectrum(120.0, 1.2, fine)[0], fine)
    assert total == pytest.approx(plain.power(120.0, 1.2)[0], rel=1e-3)


def test_a_level_steps_at_its_threshold_and_waves_elsewhere():
    level = Level(((2.0, 3.0, -1.0, 0.5),), (("speed", 100.0, 6.0), ("force", 1.0, -3.0)))
    surface = AlteredSurface("x", SURFACES["wood"], level=level)
    speed, force = np.array([80.0, 125.0, 80.0, 125.0]), np.array([0.8, 0.8, 1.3, 1.3])
    wave = 2.0 * np.cos(3.0 * np.log(speed / 100 + 0.1) - np.log(force + 0.1) + 0.5)
    expected = wave + np.array([0.0, 6.0, -3.0, 3.0])
    rise_db = 10.0 * np.log10(surface.power(speed, force) / SURFACES["wood"].power(speed, force))
    np.testing.assert_allclose(rise_db, expected, atol=0.1)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 8])
def test_a_drawn_texture_vibrates_as_its_truth_says(seed):
    surface = draw_texture("x", seed)
    for speed, force, heading in ((60.0, 0.6, 0.3), (220.0, 2.2, 2.0)):
        heading_rad = None if surface.isotropic else heading
        towards = np.cos(heading), np.sin(heading)
        normal = _made(surface, 20_000, speed, force, towards)[:, 0]
        if surface.patches is not None:
            normal = normal / surface.patches.gains()[0][0]
        frequencies, measured = welch(normal, 1000, nperseg=1000)
        expected = surface.spectrum(speed, force, frequencies[10:-10], heading_rad)[0]
        error_db = 10.0 * np.log10(measured[10:-10] / expected)
        assert abs(np.median(error_db)) < 0.6
        assert np.median(np.abs(error_db)) < 1.0
        assert normal.var() == pytest.approx(surface.power(speed, force, heading_rad)[0], rel=0.25)


def test_the_family_is_as_broad_as_it_is_said_to_be():
    drawn = [draw_texture("x", seed) for seed in range(80)]
    kinds = [(t.isotropic, t.patches is not None, t.bursts is not None) for t in drawn]
    isotropic, patchy, bursty = np.mean(kinds, axis=0)
    assert 0.4 < isotropic < 0.85
    assert 0.1 < patchy < 0.4
    assert 0.1 < bursty < 0.4
    assert 0.15 < np.mean([bool(t.level.thresholds) for t in drawn]) < 0.55
    level_db = 10.0 * np.log10([float(t.power(100.0, 1.0, 0.0)[0]) for t in drawn])
    assert -13.1 < level_db.min() < -9.0 < 5.0 < level_db.max() < 9.1
    random = np.random.default_rng(1)
    speed, force = np.exp(
        random.uniform(np.log([[20.0], [0.15]]), np.log([[300.0], [3.0]]), (2, 30))
    )
    laws = np.column_stack([np.ones(30), np.log10(speed / 100.0), np.log10(force)])
    rough = []
    for texture in drawn:
        power_db = 10.0 * np.log10(texture.power(speed, force, 0.3))
        fitted = laws @ np.linalg.lstsq(laws, power_db, rcond=None)[0]
        rough.append((power_db - fitted).std())
    assert np.percentile(rough, 5) < 1.5
    assert 1.7 < np.median(rough) < 3.0


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


@pytest.mark.parametrize("name", ["drawn-4", "drawn-11", "oak+patches-2+bursts", "drawn-2+patches"])
def test_the_truth_travels_with_a_session(name):
    surface = get_surface(name)
    again = surface_from_annotations(surface.annotations())
    assert again.name == name
    assert again.isotropic == surface.isotropic
    assert again.friction_coefficient == surface.friction_coefficient
    stroke = [50.0, 200.0], [0.5, 2.0]
    frequencies = np.arange(0.0, 500.0, 10.0)
    np.testing.assert_allclose(
        again.spectrum(*stroke, frequencies, 0.4), surface.spectrum(*stroke, frequencies, 0.4)
    )
    assert again.patches == surface.patches
    assert again.bursts == surface.bursts


def test_a_session_on_them_is_evaluated_against_the_truth(tmp_path):
    simulated = {"surface": "drawn-4", "course": {"surfaces": ["plastic+patches"], "stay_s": 2.0}}
    tables = {"simulated": simulated, "hand": {"kind": "quick"}, "link": {}, "texture": {}}
    scene = mmt.Scene.model_validate(tables)
    _, truth = mmt.simulate_session(scene, duration_s=6.0)
    surfaces = course_from_annotations(truth).surfaces
    assert [surface.name for surface in surfaces] == ["drawn-4", "plastic+patches"]
    frames, truth = mmt.simulate_session(scene, surface="wood+bursts", duration_s=10.0)
    write_session(tmp_path / "a.mcap", frames, annotations=truth)
    result = mmt.evaluate_session(mmt.read_session(tmp_path / "a.mcap"))
    assert result.basis == "truth"
    assert result.at_end.within_jnd is not None


def test_a_tick_takes_little():
    for name in ("drawn-5", "plastic+patches+bursts"):
        source = vibration_of(get_surface(name), np.random.default_rng(1))
        started = time.perf_counter()
        for tick in range(3000):
            source.step(Stroke(100.0 + 0.01 * tick, 1.0, (1.0, 0.0), (0.02 * tick, 3.0)))
        assert (time.perf_counter() - started) / 3000 < 200e-6  # 10 to 25 us on an idle machine


@pytest.mark.parametrize("stroke", [(0.0, 0.0), (1e9, 1e9), (300.0, 0.0)])
def test_at_the_ends_of_the_plane_it_stays_finite(stroke):
    surface = get_surface("drawn-3+patches+bursts")
    assert np.isfinite(surface.spectrum(*stroke, np.arange(500.0), 0.0)).all()
    source = vibration_of(surface, np.random.default_rng(1))
    assert np.isfinite(
        [source.step(Stroke(*stroke, (0.0, 1.0), (-1e4, 1e4))) for _ in range(300)]
    ).all()


@pytest.mark.parametrize(
    "name", ["wood+burst", "wood+bursts-2", "wood+patches-", "wood+patches-x", "wood+patches-90"]
)
def test_an_alteration_that_is_not_known_is_explained(name):
    if name.endswith("-"):
        assert get_surface(name).patches.deviation_db == 3.0
        return
    with pytest.raises(InputError, match=r"is not known, allowed are \+patches"):
        get_surface(name)
    with pytest.raises(InputError, match="surface is 'wod', allowed are plastic"):
        get_surface("wod+patches")
