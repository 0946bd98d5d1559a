"""A simulated tool that goes from one surface to another."""

import json
from itertools import pairwise

import numpy as np
import pytest
from known_surface_samples import odd_model

from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples
from mmt.follower.sources import build_source
from mmt.scene import Scene, Simulated
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import (
    SETTLED_TICKS,
    CourseChange,
    SurfaceCourse,
    course_from_annotations,
    surface_of,
)
from mmt.testing.simulation.surfaces.textures import get_surface, surface_from_annotations

LINKED = {"link": {}, "recording": {}, "texture": {}}
THREE = [get_surface(name) for name in ("glass", "sandpaper", "wood")]


def drawn(seed=1, when="either", duration_s=100.0):
    return SurfaceCourse.draw(THREE, stay_s=5.0, when=when, duration_s=duration_s, seed=seed)


def test_a_course_never_stays_and_depends_on_its_seed_alone():
    course = drawn()
    places = [0, *(change.surface for change in course.changes)]
    assert all(a != b for a, b in pairwise(places))
    assert set(places) == {0, 1, 2}
    gaps = np.diff([0, *(change.due_frame for change in course.changes)])
    assert gaps.min() >= 2500
    assert gaps.max() <= 7500
    assert drawn().changes == course.changes != drawn(2).changes


def test_changes_are_of_the_kind_asked_for():
    for when, kind in (("lifted", False), ("contact", True)):
        assert {change.in_contact for change in drawn(when=when).changes} == {kind}


def test_a_change_waits_for_the_tool_to_be_off_the_surface_or_on_it():
    force = np.concatenate([np.ones(100), np.zeros(100), np.ones(100)])
    lifted = SurfaceCourse(THREE, [CourseChange(50, 1, in_contact=False)])
    assert int(np.argmax(lifted.places_by_frame(force) == 1)) == 100 + SETTLED_TICKS - 1
    touching = SurfaceCourse(THREE, [CourseChange(150, 2, in_contact=True)])
    assert int(np.argmax(touching.places_by_frame(force) == 2)) == 200 + SETTLED_TICKS - 1


def test_the_truth_comes_back_from_its_annotations():
    course = drawn()
    again = course_from_annotations(course.annotations())
    assert again.changes == course.changes
    assert [surface.modes for surface in again.surfaces] == [s.modes for s in THREE]
    assert len(drawn(duration_s=86_400.0).annotations()) < 65_536


def test_no_surface_is_no_course_and_a_course_is_not_one_surface():
    with pytest.raises(InputError, match="needs a surface"):
        SurfaceCourse([], [])
    with pytest.raises(InputError, match="single surface"):
        course_from_annotations(THREE[0].annotations())
    with pytest.raises(InputError, match="mmt lab surfaces"):
        surface_from_annotations(drawn().annotations())
    surfaces = [json.loads(surface.annotations()) for surface in THREE]
    for parameters in (
        {},
        {"surfaces": [], "changes": []},
        {"surfaces": surfaces, "changes": [[1, 9, True]]},
        {"surfaces": surfaces, "changes": [[1]]},
    ):
        with pytest.raises(InputError):
            course_from_annotations(json.dumps({"version": 3, "parameters": parameters}).encode())
    for wrong in (["plastic"], ["wood", "wood"], ["velvet"]):
        simulated = Simulated.model_validate({"course": {"surfaces": wrong}})
        with pytest.raises(InputError, match=wrong[0]):
            surface_of(simulated, 10.0, 1)


def test_a_scene_names_a_course(tmp_path):
    """Of its own rate, also over altered and drawn surfaces, and over a model's file."""
    path = tmp_path / "stone.npz"
    path.write_bytes(odd_model().to_bytes())
    course = {"surfaces": ["drawn-4", "plastic+patches", str(path)], "stay_s": 2.0}
    tables = {"surface": "glass", "course": course}
    simulated = Simulated.model_validate(tables)
    drawn_course = surface_of(simulated, 100.0, 1)
    assert isinstance(drawn_course, SurfaceCourse)
    assert {change.in_contact for change in drawn_course.changes} == {False}
    assert surface_of(Simulated(), 100.0, 1) == get_surface("plastic")
    session = {"acceleration_rate_hz": 3000}
    scene = scene_from_tables({"hand": {}, **LINKED, "session": session, "simulated": tables})
    frames, annotations = simulate_session(scene, duration_s=4.0)
    assert np.isfinite(acceleration_samples(frames)).all()
    for truth in (annotations, build_source(scene).annotations):
        surfaces = course_from_annotations(truth).surfaces
        names = ["glass", "drawn-4", "plastic+patches", "stone"]
        assert [(s.name, s.rate_hz) for s in surfaces] == [(name, 3000.0) for name in names]


def test_the_recorded_vibration_is_that_of_the_surface_under_the_tool():
    course = SurfaceCourse(THREE, [CourseChange(1500, 1, in_contact=True)])
    frames, annotations = simulate_session(Scene(), course, 3.0, 4)
    under = course_from_annotations(annotations).places_by_frame(
        frames["force_n"][:, 2].astype(float)
    )
    assert set(under.tolist()) == {0, 1}
    vibration = np.diff(frames["acceleration_m_s2"][:, 2].astype(float), append=0.0)
    moving = np.arange(len(frames)) > 600
    quiet, loud = (np.mean(vibration[moving & (under == n)] ** 2) for n in (0, 1))
    assert loud > 20 * quiet
