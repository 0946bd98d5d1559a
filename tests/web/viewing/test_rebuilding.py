"""The model that a recording's page shows is the one that the leader had."""

from dataclasses import asdict
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from surface_courses import glass_and_sandpaper, stroked_over
from waiting import until

from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.session.windows import MemoryWindows
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.history import build, stream_blocks
from mmt.texture.online.updates import SurfaceChange
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.web.viewing.rebuilding import ModelRebuild, frozen_spans

NEVER = ModellingSettings(method="published", start_distance=12.0, stop_distance=1e-6)


@cache
def stroked():
    """Return the frames of a session, shape (14_000,)."""
    frames, _ = simulate_session(Scene(), "plastic", 14.0)
    return frames


@pytest.fixture
def rebuilt():
    """Give the finished building of a session's model, and close it after the test."""
    made = []

    def rebuild(settings, events=(), frames=None):
        recorded = stroked() if frames is None else frames
        windows = MemoryWindows(RecordedSession(recorded, events=events))
        made.append(rebuilding := ModelRebuild(windows, settings, 1.0))
        rebuilding.start()
        until(lambda: rebuilding.done)
        assert rebuilding.problem is None
        return rebuilding

    yield rebuild
    for each in made:
        each.close()


def test_every_state_is_that_of_the_live_leader_and_a_moment_has_the_last_one(rebuilt):
    rebuilding = rebuilt(NEVER)
    assert rebuilding.at(0.5) is None
    third = rebuilding.states[2]
    for moment_s in (third.time_s, third.time_s + 0.5):
        assert rebuilding.at(moment_s) is third
    assert rebuilding.at(1e9) is rebuilding.states[-1]
    history = build(list(stream_blocks([stroked()], 1000)), NEVER)
    assert [s.progress for s in rebuilding.states] == [u.progress for u in history.updates]
    assert [s.time_s for s in rebuilding.states] == pytest.approx(
        [u.time_s for u in history.updates], abs=0.01
    )
    for state, update in zip(rebuilding.states, history.updates, strict=True):
        assert (state.number is None) is (update.model is None)
        if state.number is not None and update.model is not None:
            model = rebuilding.snapshots.model(state.number)
            np.testing.assert_array_equal(model.points, update.model.points)


def test_a_state_says_what_was_no_measurement_until_then(rebuilt):
    frames = stroked().copy()
    frames["acceleration_m_s2"][5200:5600] = frames["acceleration_m_s2"][5200]
    rebuilding = rebuilt(NEVER, frames=frames)
    said = {round(state.time_s): state.faults for state in rebuilding.states}
    assert said[5] == ""
    assert said[6].startswith("the accelerometer held one value for 0.4 s")
    assert said[14] == said[6]


def test_the_model_is_left_alone_once_it_is_complete(rebuilt):
    settings = ModellingSettings(method="published", start_distance=20.0, stop_distance=12.0)
    rebuilding = rebuilt(settings)
    last = rebuilding.states[-1]
    assert last.stop_s == last.time_s < 13.0
    assert last.progress.value <= 12.0
    assert last.start_s is not None


def test_a_reset_begins_a_new_model(rebuilt):
    rebuilding = rebuilt(NEVER, [{"time_s": 7.5, "event": "model reset"}])
    after = [state for state in rebuilding.states if state.time_s >= 7.5]
    assert (after[0].time_s, after[0].number, after[0].start_s) == (7.5, None, None)
    begun = stroked()[7500:]
    history = build(list(stream_blocks([begun], 1000)), NEVER)
    assert [s.progress.value for s in after[1:]] == pytest.approx(
        [u.distance for u in history.updates]
    )
    before = rebuilding.at(7.4)
    assert before.number is not None


def test_a_frozen_model_does_not_grow(rebuilt):
    events = [
        {"time_s": 5.0, "event": "model frozen", "frozen": True},
        {"time_s": 9.0, "event": "model grows again", "frozen": False},
    ]
    rebuilding = rebuilt(NEVER, events)
    assert [s for s in rebuilding.states if 6.0 < s.time_s < 9.5] == []
    assert rebuilding.states[-1].time_s > 12.0


def test_a_freeze_ends_with_the_recording_or_a_reset():
    freeze = {"at_s": 2.0, "event": "model frozen", "frozen": True}
    reset = {"at_s": 3.0, "event": "model reset"}
    assert frozen_spans([freeze], 8.0) == [(2.0, 8.0)]
    assert frozen_spans([freeze, reset], 8.0) == [(2.0, 3.0)]


def test_each_surface_has_its_own_model_and_criteria(rebuilt):
    frames, _ = stroked_over(glass_and_sandpaper(7000, 13_000))
    criteria = {"start_distance": 20.0, "stop_distance": 9.0, "surfaces": SurfaceSettings()}
    settings = ModellingSettings(order=10, method="published", **criteria)
    said = SurfaceChange("recalled", 2, 1, 13_300, 13_300)
    event = {"at_s": 13.3, "time_s": 13.3, "event": "surface 1 again"} | asdict(said)
    rebuilding = rebuilt(settings, (event,), frames)
    states = rebuilding.states
    surfaces = [state.surface for state in states]
    assert [a for a, b in pairwise([*surfaces, None]) if a != b] == [1, 2, 1]
    assert (states[0].surfaces, states[-1].surfaces) == (1, 2)
    first = next(state for state in states if state.stop_s is not None)
    second = next(state for state in states if state.surface == 2)
    last = states[-1]
    assert second.start_s is None or second.start_s > 7.0
    assert (last.start_s, last.stop_s) == (first.start_s, first.stop_s)
    assert last.number is not None
    model = rebuilding.snapshots.model(last.number)
    other = max(s.number for s in states if s.surface == 2 and s.number is not None)
    assert rebuilding.snapshots.model(other).samples.power.mean() > 30 * model.samples.power.mean()


def test_building_can_be_left_at_any_time():
    windows = MemoryWindows(RecordedSession(stroked()))
    rebuilding = ModelRebuild(windows, NEVER, 1.0)
    rebuilding.start()
    rebuilding.close()
    assert rebuilding.done
