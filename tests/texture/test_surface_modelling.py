"""A model for each surface from one stream: which frames each is made of, and when."""

from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest
from surface_courses import glass_and_sandpaper, stroked_over

from mmt.scene import Hand, Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import CourseChange, SurfaceCourse
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.updates import SurfaceChange, SurfaceStatement, surface_statements
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.aligned import SignalFaults
from mmt.texture.surfaces import modeller as modelling
from mmt.texture.surfaces.modeller import SurfaceModeller
from mmt.texture.surfaces.tracking import NAMED_S, follow_surfaces, surface_changes

SETTINGS = ModellingSettings(method="published", order=10, surfaces=SurfaceSettings())
Changes = dict[int, list[SurfaceChange]]


def change(kind, before, surface, from_sample, at):
    return SurfaceChange(kind, before, surface, from_sample, at, 20.0)


class ScriptedTracker:
    """Finds the changes that a test names, each in the look that ends at its sample."""

    script: Changes = {}  # noqa: RUF012 - set by `scripted` for each test

    def __init__(self, *_):
        self.surface = 1
        self.surfaces = {1}
        self.faults = SignalFaults()

    def update(self, frames):
        found = self.script.get(int(frames["sequence"][-1]) + 1, [])
        for one in found:
            self.surface = one.surface
            self.surfaces.add(one.surface)
            if one.kind == "identified":
                self.surfaces.remove(one.before)
        return found


@pytest.fixture
def scripted(monkeypatch):
    def make(script):
        monkeypatch.setattr(ScriptedTracker, "script", script)
        monkeypatch.setattr(modelling, "SurfaceTracker", ScriptedTracker)
        return SurfaceModeller(SETTINGS, 1000)

    return make


@pytest.fixture(scope="module")
def frames():
    return simulate_session(Scene(), "sandpaper", 12.0, 4)[0]


def updates(modeller, frames, look=100):
    for start in range(0, len(frames), look):
        update = modeller.update(frames[start : start + look])
        if update is not None:
            yield update


def alone(*stays):
    """A model of these frames and no others, with an update for each part."""
    modeller = OnlineModeller(replace(SETTINGS, surfaces=None))
    for stay in stays:
        modeller.update(stay)
    return modeller


def test_each_model_is_made_of_the_frames_of_its_surface_alone(scripted, frames):
    modeller = scripted(
        {4300: [change("new", 1, 2, 4050, 4300)], 8600: [change("recalled", 2, 1, 8250, 8600)]}
    )
    found = list(updates(modeller, frames))
    reported = [(u.time_s, u.surface, [c.kind for c in u.changes]) for u in found if u.changes]
    assert reported == [(4.3, 2, ["new"]), (8.6, 1, ["recalled"])]
    assert [u.surface for u in found] == [1] * 4 + [2] * 5 + [1] * 4
    # Samples lag behind: what is cut at 4050 ends before, what is given from 4050 begins behind.
    models = modeller.models()
    parts = [frames[:1000], frames[1000:2000], frames[2000:3000], frames[3000:4000]]
    first = alone(*parts, frames[4000:4050])
    first.remove_after(4050)
    for part in (frames[8250:8600], frames[8600:9600], frames[9600:10_600], frames[10_600:11_600]):
        first.update(part)
    np.testing.assert_array_equal(models[1].samples.power, first.model.samples.power)
    cuts = [4050, 4300, 5300, 6300, 7300, 8250]
    second = alone(*(frames[a:b] for a, b in pairwise(cuts)))
    second.remove_after(8250)
    np.testing.assert_array_equal(models[2].samples.power, second.model.samples.power)
    np.testing.assert_array_equal(models[2].samples.inputs, second.model.samples.inputs)


def test_what_was_left_is_told_as_it_is_without_the_frames_of_the_next(scripted, frames):
    modeller = scripted({6000: [change("new", 1, 2, 3000, 6000)]})
    *_, update = updates(modeller, frames[:6000])
    (left,) = update.left
    grown = alone(frames[:3000])
    assert (left.surface, left.time_s) == (1, 3.0)
    assert 0 < left.samples <= len(grown.fits) + 1
    assert left.model is not None
    assert left.distance > update.distance  # three seconds against the next three


def test_a_surface_that_turns_out_to_be_a_known_one_hands_over_its_frames(scripted, frames):
    modeller = scripted(
        {
            3200: [change("new", 1, 2, 3000, 3200)],
            6200: [change("new", 2, 3, 6000, 6200)],
            9200: [change("identified", 3, 1, 6000, 9200)],
        }
    )
    found = list(updates(modeller, frames))
    assert sorted(modeller.models()) == [1, 2]
    identified = next(u for u in found if u.changes and u.changes[0].kind == "identified")
    assert identified.left == ()
    before = alone(frames[:3000])
    assert identified.samples > len(before.fits) + 3  # three seconds of strokes at once


def test_two_changes_in_one_look_behind_leave_each_surface_its_own(scripted, frames):
    """As when updates cannot keep up, and everything that waits comes at once."""
    script = {5000: [change("new", 1, 2, 4800, 5000)], 8000: [change("recalled", 2, 1, 7800, 8000)]}
    behind = scripted(script)
    (update,) = updates(behind, frames, look=len(frames))
    assert [c.kind for c in update.changes] == ["new", "recalled"]
    assert [left.surface for left in update.left] == [1, 2]
    in_time = scripted(script)
    list(updates(in_time, frames))
    for number, model in in_time.models().items():
        late = behind.models()[number].samples
        assert abs(len(late) - len(model.samples)) <= 6
        np.testing.assert_allclose(
            np.log(late.power).mean(), np.log(model.samples.power).mean(), atol=0.5
        )


def test_a_model_that_is_complete_stays_as_it_is_until_the_end(scripted, frames, monkeypatch):
    monkeypatch.setattr(
        "test_surface_modelling.SETTINGS", replace(SETTINGS, start_distance=20.0, stop_distance=9.0)
    )
    modeller = scripted(
        {4300: [change("new", 1, 2, 4050, 4300)], 8600: [change("recalled", 2, 1, 8250, 8600)]}
    )
    found = list(updates(modeller, frames))
    complete = next(u for u in found if u.stopped)
    left = next(u for u in found if u.left).left[0]
    assert complete.time_s < 4.05
    assert left.stopped
    last = found[-1]
    assert last.surface == 1
    assert last.model is left.model


OVER_TWO = glass_and_sandpaper()


@pytest.fixture(scope="module")
def over_two():
    return stroked_over(OVER_TWO)[0]


def test_each_change_opens_a_model_of_the_frames_of_one_surface(over_two):
    under = OVER_TWO.places_by_frame(over_two["force_n"][:, 2].astype(float))
    edges = (np.flatnonzero(np.diff(under)) + 1).tolist()
    modeller = SurfaceModeller(SETTINGS, 1000)
    found = [c for u in updates(modeller, over_two) for c in u.changes]
    assert [(c.kind, c.surface) for c in found] == [("new", 2), ("new", 3)]
    for one, true in zip(found, edges, strict=True):
        assert true - 300 < one.from_sample < true + 1000
        assert true < one.at_sample < true + 2500
    powers = {n: float(model.samples.power.mean()) for n, model in modeller.models().items()}
    assert powers[2] > 100 * max(powers[1], powers[3])


def test_a_person_says_that_the_new_surface_is_one_met_before(over_two):
    """What a model gets does not depend on how frames come, nor on when it was said."""
    powers = []
    for look in (50, 170, 1000):
        modeller = SurfaceModeller(SETTINGS, 1000)
        modeller.state_surface(SurfaceStatement(16_000, 1))
        found = [c for u in updates(modeller, over_two, look) for c in u.changes]
        assert [(c.kind, c.surface) for c in found] == [("new", 2), ("new", 3), ("identified", 1)]
        assert found[2].from_sample == found[1].from_sample
        assert (found[2].at_sample, found[2].evidence) == (16_000, None)
        assert modeller.surface == 1
        assert sorted(modeller.models()) == [1, 2]
        powers.append(np.sort(modeller.models()[1].samples.power))
        assert powers[-1].max() < 0.01 * modeller.models()[2].samples.power.mean()


def test_what_a_person_says_is_found_again_in_the_events(over_two):
    modeller = SurfaceModeller(SETTINGS, 1000)
    modeller.state_surface(SurfaceStatement(13_500, 1))
    found = [c for u in updates(modeller, over_two) for c in u.changes]
    said = surface_statements([*({"kind": c.kind} | asdict(c) for c in found), {"event": "mark"}])
    assert said == [SurfaceStatement(13_500, 1)]
    assert list(surface_changes(over_two, SETTINGS, said)) == found
    told = [c.surface for c in follow_surfaces(over_two, SETTINGS, statements=said)]
    assert told == [c.surface for c in found]


def tracked(frames, *said):
    changes = surface_changes(frames, SETTINGS, said)
    return [(c.kind, c.before, c.surface, c.from_sample) for c in changes]


def test_a_word_long_after_a_change_is_a_change_of_its_own(frames):
    words = [
        SurfaceStatement(2000, 2),
        SurfaceStatement(4000, 1),
        SurfaceStatement(4000, 1),
        SurfaceStatement(6000, 7),
    ]
    assert tracked(frames, *words) == [
        ("new", 1, 2, 2000),
        ("recalled", 2, 1, 4000),
        ("new", 1, 7, 6000),
    ]


def test_a_word_is_about_the_surface_since_the_detected_change(over_two):
    first, second = tracked(over_two)
    (found, *_) = surface_changes(over_two, SETTINGS)
    in_time = SurfaceStatement(found.at_sample + 200, 1)  # the filters delay what is found
    merged = tracked(over_two[: found.at_sample + 300], in_time)
    assert merged == [first, ("identified", 2, 1, first[3])]
    named = round(NAMED_S * SETTINGS.rate_hz)
    longer = np.concatenate([over_two[:12_000], over_two[6500:12_000]])
    longer["sequence"] = np.arange(len(longer))
    longer["time_ns"] = 1_000_000 * np.arange(len(longer))
    late = SurfaceStatement(found.at_sample + named + 1, 1)
    assert tracked(longer, late)[-1][0] == "recalled"
    assert second[0] == "new"


def test_the_surface_left_longest_ago_is_dropped(frames):
    settings = replace(SETTINGS, surfaces=SurfaceSettings(most=2))
    modeller = SurfaceModeller(settings, 1000)
    for sample, surface in ((3000, 2), (6000, 1), (9000, 3)):
        modeller.state_surface(SurfaceStatement(sample, surface))
    list(updates(modeller, frames))
    assert sorted(modeller.models()) == [1, 3]


def test_strokes_at_other_headings_are_not_another_surface():
    """Corduroy's vibration depends on the heading; that of glass is another one altogether."""
    course = SurfaceCourse(
        [get_surface("corduroy"), get_surface("glass")],
        [CourseChange(25_000, 1, in_contact=False)],
    )
    scene = Scene.model_validate(
        {"hand": Hand(headings="all"), "link": {}, "simulated": {}, "recording": {}}
    )
    frames, _ = simulate_session(scene, course, 33.0, 2)
    modeller = SurfaceModeller(replace(SETTINGS, inputs="anisotropic"), 1000)
    found = [c for u in updates(modeller, frames) for c in u.changes]
    assert [(c.kind, c.surface) for c in found] == [("new", 2)]
    assert all(model.space.directed for model in modeller.models().values())
