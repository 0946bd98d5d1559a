"""A recorded stroke as the motion of a simulated session."""

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.scene import Hand, Scene
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.recorded_path import load_path
from mmt.testing.simulation.surfaces.course import CourseChange, SurfaceCourse
from mmt.testing.simulation.surfaces.textures import get_surface, surface_from_annotations


def _tool(rate_hz=2000.0, duration_s=3.0):
    time_s = np.arange(0.0, duration_s, 1.0 / rate_hz)
    position_mm = np.zeros((time_s.size, 3))
    position_mm[:, 0] = 20.0 * np.sin(4 * np.pi * time_s)
    position_mm[:, 1] = 3.0 * np.cos(2 * np.pi * time_s)
    force_n = np.zeros((time_s.size, 3))
    force_n[:, 2] = 1.5 + 0.5 * np.sin(2 * np.pi * time_s)
    return {"time_s": time_s, "position_mm": position_mm, "force_n": force_n}


def _saved(tmp_path, arrays):
    file = tmp_path / "stroke.npz"
    np.savez(file, **arrays)
    return file


@pytest.mark.parametrize("rate_hz", [333.0, 1000.0, 2000.0, 5000.0])
@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_any_rate_becomes_the_sessions_and_lost_samples_are_bridged(tmp_path, rate_hz, lost):
    arrays = _tool(rate_hz)
    kept = np.random.default_rng(1).random(len(arrays["time_s"])) >= lost
    kept[[0, -1]] = True
    path = load_path(_saved(tmp_path, {name: array[kept] for name, array in arrays.items()}))
    time_s = np.arange(len(path.force_n)) * 1e-3
    assert len(time_s) == pytest.approx(3000, abs=8)
    inner = slice(150, -150)
    within_mm = 0.05 if lost else 0.02
    expected = 20.0 * np.sin(4 * np.pi * time_s)
    np.testing.assert_allclose(path.position_mm[inner, 0], expected[inner], atol=within_mm)
    expected = 1.5 + 0.5 * np.sin(2 * np.pi * time_s)
    np.testing.assert_allclose(path.force_n[inner], expected[inner], atol=0.1 * within_mm)


def test_what_lies_above_the_band_does_not_fold_back(tmp_path):
    arrays = _tool(2000.0)
    tone = np.sin(2 * np.pi * 700.0 * arrays["time_s"])
    arrays["force_n"][:, 2] += tone
    arrays["position_mm"][:, 0] += tone
    clean = load_path(_saved(tmp_path, _tool(2000.0)))
    path = load_path(_saved(tmp_path, arrays))
    inner = slice(150, -150)
    assert np.abs(path.force_n - clean.force_n)[inner].max() < 1e-3
    assert np.abs(path.position_mm - clean.position_mm)[inner].max() < 1e-3


def test_loop_joins_without_a_jump(tmp_path):
    file = _saved(tmp_path, _tool())
    path = load_path(file)
    looped = path.looped(20_000)
    assert len(looped.force_n) == 20_000
    np.testing.assert_array_equal(looped.position_mm[:2000], path.position_mm[:2000])
    assert np.abs(np.diff(looped.position_mm[:, 0])).max() < 20.0 * 4 * np.pi * 1.02e-3
    assert np.abs(np.diff(looped.position_mm[:, 0], n=2)).max() < 0.02
    assert np.abs(np.diff(looped.force_n)).max() < 0.5 * 2 * np.pi * 1.02e-3
    assert looped.position_mm[15_000:, 0].std() == pytest.approx(14.1, rel=0.1)
    hand = SimulatedHand(Hand(kind=str(file)), 1)  # follows it for as long as a session lasts
    assert np.ptp([hand.read(1).position_mm[0] for _ in range(10_000)]) == pytest.approx(
        40, rel=0.1
    )


def test_session_on_a_recorded_stroke(tmp_path):
    file = _saved(tmp_path, _tool())
    frames, annotations = simulate_session(
        Scene(), "plastic", 5.0, 3, path=file, motion_scale=1.5, force_scale=0.5
    )
    assert len(frames) == 5000
    time_s = np.arange(5000) * 1e-3
    inner = slice(200, 2000)
    expected = 30.0 * np.sin(4 * np.pi * time_s)
    np.testing.assert_allclose(frames["position_mm"][inner, 0], expected[inner], atol=0.05)
    expected = 0.75 + 0.25 * np.sin(2 * np.pi * time_s)
    np.testing.assert_allclose(frames["force_n"][inner, 2], expected[inner], atol=0.02)
    assert frames["position_mm"][inner, 2].max() < 0.0
    drag = np.sum(frames["force_n"][1:, :2] * np.diff(frames["position_mm"][:, :2], axis=0))
    assert drag < 0.0
    assert surface_from_annotations(annotations).name == "plastic"


def test_each_surface_on_the_way_has_its_own_friction(tmp_path):
    surfaces = [get_surface(name) for name in ("glass", "rubber")]
    course = SurfaceCourse(surfaces, [CourseChange(2500, 1, in_contact=True)])
    frames, _ = simulate_session(Scene(), course, 5.0, 3, path=_saved(tmp_path, _tool()))
    force_n = frames["force_n"].astype(float)
    gripped = np.hypot(force_n[:, 0], force_n[:, 1]) / force_n[:, 2]
    found = [gripped[:2500].max(), gripped[2600:].max()]
    expected = [surface.friction_coefficient for surface in surfaces]
    assert expected[0] != expected[1]
    np.testing.assert_allclose(found, expected, rtol=0.1)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"force_n": np.zeros(6000)}, "must be"),
        ({"time_s": np.zeros(6000)}, "rise"),
        ({"time_s": np.arange(17.0)}, "shapes"),
        ({"position_mm": np.full((6000, 3), np.nan)}, "finite"),
        (_tool(duration_s=0.1), "shorter"),
        ({"time_s": np.append(np.arange(5999) * 5e-4, 1e9)}, "gaps"),
        ({"position_mm": np.array(["a"] * 6000)}, "numbers"),
    ],
)
def test_bad_files_are_explained(tmp_path, arrays, message):
    with pytest.raises(InputError, match=message):
        load_path(_saved(tmp_path, _tool() | arrays))


def test_files_that_are_no_recorded_stroke_are_explained(tmp_path):
    file = tmp_path / "stroke.npz"
    with pytest.raises(InputError, match="No such file"):
        load_path(file)
    file.write_text("not arrays")
    with pytest.raises(InputError, match="archive of numbers"):
        load_path(file)
    np.savez(file, time_s=np.zeros(3))
    with pytest.raises(InputError, match="missing"):
        load_path(file)
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(InputError, match="single array"):
        load_path(tmp_path / "single.npy")


@pytest.mark.parametrize("scale", [0.0, -1.0, 101.0, np.inf, np.nan])
def test_scales_out_of_range_are_refused(tmp_path, scale):
    path = load_path(_saved(tmp_path, _tool()))
    with pytest.raises(InputError, match="motion_scale"):
        path.scaled(scale, 1.0)
    with pytest.raises(InputError, match="force_scale"):
        path.scaled(1.0, scale)
