"""A moment of a recording, as its page gets it."""

from itertools import accumulate
from typing import get_args

import numpy as np
import pytest
from frame_samples import made_frames
from hypothesis import given
from hypothesis import strategies as st
from monitor_messages import unpack

from mmt.core.errors import InputError
from mmt.core.frames import frame_dtype
from mmt.leader.output.vibration import Mode
from mmt.scene import Scene
from mmt.session.data import OutputBlock, RecordedSession
from mmt.session.files import export_session
from mmt.session.stream import open_windows
from mmt.session.windows import MemoryWindows, Window
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.settings import ModellingSettings
from mmt.web.viewing import traces
from mmt.web.viewing.recording import ViewedRecording
from mmt.web.viewing.traces import LinkRecord, session_events

SETTINGS = ModellingSettings()


def window(count, first=0):
    frames = made_frames(first, count)
    return Window(frames["sequence"] / 1e3, frames)


def test_samples_stand_at_their_moment_and_a_gap_stays_empty():
    whole = window(2000)
    missing = (whole.frames["sequence"] >= 1700) & (whole.frames["sequence"] < 1750)
    shown = traces.measured(Window(whole.time_s[~missing], whole.frames[~missing]), 2.0, SETTINGS)
    assert np.flatnonzero(np.isnan(shown)).tolist() == list(range(512 - 300, 512 - 250))
    later = traces.measured(whole, 2.1, SETTINGS)  # nothing came for a tenth of a second
    assert np.flatnonzero(np.isnan(later)).tolist() == list(range(412, 512))


def test_several_samples_a_frame_are_shown_at_their_own_rate():
    frames = np.zeros(2000, frame_dtype(samples_per_frame=4))
    frames["sequence"] = np.arange(2000)
    time_s = np.arange(1, 8001) / 4000
    tone = np.sin(2 * np.pi * 1500.0 * time_s)
    frames["acceleration_m_s2"][..., 2] = tone.reshape(-1, 4)
    settings = ModellingSettings(samples_per_frame=4)
    present = np.arange(2000) // 5 != 1990 // 5
    end = Window(frames["sequence"][present] / 1e3, frames[present])
    shown = traces.measured(end, 2.0, settings)
    missing = np.isnan(shown)
    assert np.flatnonzero(missing).tolist() == list(range(512 - 40, 512 - 20))
    np.testing.assert_allclose(shown[~missing], tone[-512:][~missing], atol=0.15)
    blocks = [OutputBlock(t, "streamed", np.full(400, 10 * t), 4) for t in (1.0, 1.1)]
    played = traces.played(blocks, 1.2).vibration_m_s2
    np.testing.assert_array_equal(played, [10.0] * 112 + [11.0] * 400)


def test_a_model_is_rendered_along_the_motion_between_frames(monkeypatch):
    given = []

    class Noted:
        def __init__(self, model, *, seed):
            pass

        def render(self, *inputs):
            given.extend(inputs)
            return inputs[0]

    monkeypatch.setattr(traces, "Synthesizer", Noted)
    frames = np.zeros(3000, frame_dtype(samples_per_frame=4))
    frames["sequence"], frames["time_ns"] = np.arange(3000), np.arange(3000) * 1_000_000
    frames["force_n"][:, 2] = 1.0 + np.linspace(0.0, 1.0, 3000)
    model = TextureModel(TextureSamples.isotropic([100.0], [1.0], [[1.0, 2.0]], [1.0], [1.0]))
    window = Window(np.arange(3000) / 1e3, frames)
    traces.synthesized(window, 3.0, ModellingSettings(samples_per_frame=4), model)
    force_n = given[-1]
    assert len(force_n) % 4 == 0
    np.testing.assert_allclose(np.diff(force_n)[3:], 1.0 / 2999 / 4, rtol=1e-3)


def test_the_page_is_told_the_rate_of_what_vibrates():
    frames = made_frames(0, 2000, ["acceleration"], 4)
    frames["acceleration_m_s2"] = 0.0
    recording = ViewedRecording(MemoryWindows(RecordedSession(frames)))
    assert unpack(recording.opening())["rate_hz"] == 4000.0
    measured = unpack(recording.state_at(1.999))["arrays"]["measured"]
    assert (measured == 0.0).all()


def test_what_was_played_stands_at_its_moment():
    played = ((1.0, "streamed", 2.0), (1.1, "synthesized", 3.0))
    blocks = [OutputBlock(at_s, mode, np.full(100, value)) for at_s, mode, value in played]
    shown = traces.played(blocks, 1.2)
    expected = np.repeat([np.nan, 2.0, 3.0], [312, 100, 100])
    np.testing.assert_array_equal(shown.vibration_m_s2, expected)
    assert shown.modelled.tolist() == [0.0] * 412 + [1.0] * 100
    assert np.isnan(traces.played(blocks, 50.0).vibration_m_s2).all()


def test_a_late_tick_leaves_no_hole_in_what_was_played():
    late_s = (0.0, 0.003, -0.001, 0.012, 0.0, 0.002)
    blocks = [
        OutputBlock(1.0 + 0.1 * k + late, "synthesized", np.arange(100.0) + 100 * k)
        for k, late in enumerate(late_s)
    ]
    shown = traces.played(blocks, 1.6).vibration_m_s2
    np.testing.assert_array_equal(shown, np.arange(86.0, 598.0))
    lost = [*blocks[:3], *blocks[4:]]  # a hole that is one stays
    assert np.isnan(traces.played(lost, 1.6).vibration_m_s2).sum() == 103


def test_a_rendered_sample_is_the_same_a_moment_later():
    frames, _ = simulate_session(Scene(), "plastic", 4.0)
    time_s = (frames["sequence"] - frames["sequence"][0]) / 1e3
    samples = TextureSamples.isotropic(
        [50.0, 150.0, 250.0], [1.0, 2.0, 1.0], [[0.5, 1.5]] * 3, np.ones(3), np.ones(3)
    )
    model = TextureModel(samples)
    shown = [
        traces.synthesized(
            Window(time_s[time_s < end], frames[time_s < end]), end, SETTINGS, model
        ).vibration_m_s2
        for end in (3.0, 3.04)
    ]
    earlier, later = shown[0][40:], shown[1][:-40]
    both = ~np.isnan(earlier) & ~np.isnan(later)
    assert both.sum() > 400
    assert np.abs(earlier[both]).max() > 0.1
    np.testing.assert_array_equal(earlier[both], later[both])
    after_gap = (time_s < 1.0) | ((time_s >= 3.0) & (time_s < 3.005))
    first = Window(time_s[after_gap], frames[after_gap])
    assert np.isnan(traces.synthesized(first, 3.005, SETTINGS, model).vibration_m_s2).all()


def test_what_was_played_before_and_after_a_hole_is_told_apart():
    begins = {0.0: "streamed", 0.02: "streamed", 0.041: "fading", 0.06: "synthesized"}
    begins[1.0] = "streamed"
    found = traces.modes([OutputBlock(at, mode, np.zeros(20)) for at, mode in begins.items()])
    assert [mode for *_, mode in found] == ["streamed", "synthesized", "streamed"]
    ends = [(0.0, 0.04), (0.041, 0.08), (1.0, 1.02)]
    np.testing.assert_allclose([each[:2] for each in found], ends)


@given(st.lists(st.tuples(st.sampled_from(get_args(Mode)), st.integers(1, 300)), max_size=30))
def test_each_moment_is_told_as_what_was_played_then(played):
    expected = np.array([drawn(mode) for mode, count in played for _ in range(count)], dtype="U11")
    begins = accumulate((count for _, count in played), initial=0)
    blocks = [
        OutputBlock(begin / 1e3, mode, np.zeros(count))
        for (mode, count), begin in zip(played, begins, strict=False)
    ]
    told = np.full(len(expected), "", dtype="U11")
    for begin_s, end_s, mode in traces.modes(blocks):
        told[round(1e3 * begin_s) : round(1e3 * end_s)] = mode
    assert told.tolist() == expected.tolist()


def drawn(mode):
    """Return the colour of what is played; none for silence."""
    return {"silent": "", "fading": "synthesized"}.get(mode, mode)


def test_the_trail_is_the_mean_motion_of_each_step():
    frames = made_frames(0, 400)
    frames["position_mm"] = np.arange(400)[:, None] * np.array([0.05, -0.1, 0.0])
    frames["force_n"] = [0.0, 0.0, 1.25]
    trail = traces.motion_trace(Window(np.arange(400) / 1e3, frames), SETTINGS)
    assert trail.shape == (9, 3)
    np.testing.assert_allclose(trail, np.tile([50.0, -100.0, 1.25], (9, 1)), rtol=1e-4)


def test_no_line_is_drawn_across_a_gap():
    whole = window(4000)
    kept = (whole.time_s < 1.0) | (whole.time_s > 3.0)
    time_s, force, position = traces.course(Window(whole.time_s[kept], whole.frames[kept]))
    assert (np.diff(time_s) > 0).all()
    assert np.isnan(force).all(axis=0).sum() == np.isnan(position).all(axis=0).sum() == 1
    frames = made_frames(0, 1000)
    frames["sequence"][500:] += 36_000_000  # ten hours
    frames["time_ns"][500:] += 36_000_000 * 1_000_000
    recording = ViewedRecording(MemoryWindows(RecordedSession(frames)))
    course = unpack(recording.course(36e3 + 0.6, 4e4))
    recording.close()
    times_s = course["from_s"] + course["arrays"]["time_s"].astype(np.float64)
    np.testing.assert_allclose(times_s, 36e3 + np.arange(0.6, 1.0, 1e-3), atol=1.5e-3)
    np.testing.assert_allclose(np.diff(times_s), 1e-3, atol=1e-6)


def test_of_events_a_person_gets_what_matters():
    events = [
        {"at_s": -0.1, "event": "follower connected"},
        {"at_s": 1.0, "event": "clocks compared", "clock_uncertainty_ns": 5},
        {"at_s": 2.0, "kind": "gap", "event": "gap", "frames": 30},
        {"at_s": 2.5, "kind": "filled", "event": "filled", "frames": 30, "lost": 10},
        {"at_s": 3.0, "event": "marked: wood", "mark": "wood"},
        {"at_s": 4.0, "event": "start criterion met at 4.0 s"},
    ]
    found = [(h.at_s, h.kind) for h in session_events(events)]
    assert found == [(0.0, "other"), (2.0, "gap"), (3.0, "mark"), (4.0, "criterion")]
    assert LinkRecord(events).at(2.1, np.zeros((0, 2), np.int64))["missed"] == 30
    table = LinkRecord(events).at(9.0, np.zeros((0, 2), np.int64))
    assert (table["missed"], table["filled"], table["lost"]) == (30, 20, 10)


def test_latencies_are_told_on_one_clock():
    clock = {"at_s": 0.0, "clock_time_ns": 0, "clock_offset_ns": 5_000_000_000}
    clock |= {"clock_drift_ppm": 10.0, "clock_uncertainty_ns": 1000}
    came = np.arange(100, dtype=np.int64) * 10_000_000
    sent = came - 3_000_000 + 5_000_000_000 + came // 100_000
    table = LinkRecord([clock]).at(1.0, np.column_stack([came, sent]))
    assert table["latency_p50_ms"] == pytest.approx(3.0, abs=1e-3)
    assert sum(table["counts"]) == 100
    assert table["counts"][table["bounds_ms"].index(5)] == 100  # between 2 and 5 ms


def test_a_comparison_of_clocks_counts_on_its_side_of_a_jump_only():
    before, after = (
        {"at_s": at_s, **dict.fromkeys(("clock_time_ns", "clock_drift_ppm"), 0)}
        | {"clock_offset_ns": offset_ms * 1_000_000, "clock_uncertainty_ns": 1000}
        for at_s, offset_ms in ((0.0, 0), (10.0, 700))
    )
    jump = {"at_s": 2.0, "clock_time_ns": 0, "clock_step_ns": -700_000_000}
    record = LinkRecord([before, jump, after])
    none = np.zeros((0, 2), np.int64)
    offsets = [record.at(at_s, none)["clock"]["offset_ms"] for at_s in (1.9, 2.0, 9.0)]
    assert offsets == [0.0, 700.0, 700.0]


def test_a_recording_without_force_is_shown_without_a_model(tmp_path):
    frames = made_frames(0, 1000, ("position", "acceleration"))
    export_session(RecordedSession(frames), tmp_path / "no-force.mcap")
    recording = ViewedRecording(open_windows(tmp_path / "no-force.mcap"))
    recording.start()
    opening = unpack(recording.opening())
    assert opening["remarks"] == ["No model: the recording has no force channel."]
    moment = unpack(recording.state_at(0.9))
    assert (moment["model"], moment["source"]) == (None, None)
    course = unpack(recording.course(0.2, 0.9))["arrays"]
    assert np.isnan(course["force_n"]).all()
    assert not np.isnan(course["position_mm"]).any()
    assert course["time_s"][[0, -1]] == pytest.approx([0.0, 0.7], abs=2e-3)
    assert not np.isnan(moment["arrays"]["measured"]).all()
    assert unpack(recording.growth())["done"]
    with pytest.raises(InputError, match="there is no model 0"):
        recording.model(0)
    recording.close()


def test_a_scene_that_is_not_understood_gives_way_to_the_defaults():
    scene = {"session": {"name": "old"}, "gone": {}}
    recording = ViewedRecording(MemoryWindows(RecordedSession(made_frames(0, 100), scene=scene)))
    assert "gone" in unpack(recording.opening())["remarks"][0]
    recording.close()
