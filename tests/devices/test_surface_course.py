"""A simulated tool that goes from one surface to another."""

import json
from itertools import pairwise

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.follower.sources import build_source
from mmt.scene import Scene, Simulated
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import (
    SETTLED_TICKS,
    CourseChange,
    SurfaceCourse,
    course_from_annotations,
    surface_of,
)
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations
from mmt.testing.simulation.surfaces.textures import get_surface

LINKED = {"link": {}, "recording": {}}
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


@pytest.mark.parametrize(("when", "kinds"), [("lifted", {False}), ("contact", {True})])
def test_changes_are_of_the_kind_asked_for(when, kinds):
    assert {change.in_contact for change in drawn(when=when).changes} == kinds


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


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"surfaces": [], "changes": []},
        {"surfaces": [json.loads(s.annotations()) for s in THREE], "changes": [[1, 9, True]]},
        {"surfaces": [json.loads(s.annotations()) for s in THREE], "changes": [[1]]},
    ],
)
def test_annotations_that_hold_no_course_are_refused(parameters):
    with pytest.raises(InputError):
        course_from_annotations(json.dumps({"version": 3, "parameters": parameters}).encode())


def test_a_scene_names_a_course():
    tables = {"surface": "glass", "course": {"surfaces": ["sandpaper", "wood"], "stay_s": 5.0}}
    simulated = Simulated.model_validate(tables)
    course = surface_of(simulated, 100.0, 1)
    assert isinstance(course, SurfaceCourse)
    assert course.changes == drawn(when="lifted").changes
    assert surface_of(Simulated(), 100.0, 1) == get_surface("plastic")
    scene = Scene.model_validate({"hand": {}, **LINKED, "simulated": tables})
    source = build_source(scene)
    assert course_from_annotations(source.annotations).surfaces[0].name == "glass"
    _, annotations = simulate_session(scene, None, 0.05)
    assert len(course_from_annotations(annotations).surfaces) == 3


@pytest.mark.parametrize(
    "surfaces", [["plastic"], ["wood", "wood"], ["velvet"]], ids=["stays", "twice", "unknown"]
)
def test_a_course_over_wrong_surfaces_is_refused(surfaces):
    simulated = Simulated.model_validate({"course": {"surfaces": surfaces}})
    with pytest.raises(InputError, match=surfaces[0]):
        surface_of(simulated, 10.0, 1)


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
