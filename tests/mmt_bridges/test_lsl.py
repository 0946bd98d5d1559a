"""The part for LSL against a stand-in of pylsl; the library itself: `test_lsl_services.py`."""

import json
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from frame_samples import made_frames
from publishing_samples import OFFSET_NS, Publishing
from waiting import until

from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples
from mmt.leader import publishing
from mmt.leader.building import LeaderParts
from mmt.leader.part import Session
from mmt.leader.publishing import clock_ahead_ns
from mmt.scene.files import scene_from_tables
from mmt_bridges.lsl import part as lsl
from mmt_bridges.lsl import streams as lsl_streams
from mmt_bridges.lsl.part import LslPart
from mmt_bridges.lsl.streams import load_pylsl

AHEAD_NS = 7_000_000_000_000


class Outlet:
    """Keeps what is pushed; waits before it where it is held, and fails where it is broken."""

    def __init__(self, info, max_buffered):
        self.info = info
        self.samples = []
        self.holding, self.arrived = threading.Event(), threading.Event()
        self.holding.set()
        self.broken = False

    def push_chunk(self, values, stamps_s):
        self.arrived.set()
        assert self.holding.wait(30)
        if self.broken:
            raise RuntimeError("an internal error has occurred.")
        assert values.shape == (len(stamps_s), self.info["channel_count"])
        assert values.dtype == np.float32
        self.samples += zip(stamps_s, values.tolist(), strict=True)

    def push_sample(self, values, stamp_s):
        self.samples.append((stamp_s, *values))

    def have_consumers(self):
        return False


class Info(dict[str, Any]):
    def desc(self):
        return self

    def append_child(self, name):
        return self

    def append_child_value(self, name, value):
        self.setdefault(name, []).append(value)
        return self


def stream_info(name, kind, channel_count, rate_hz, form, source):
    return Info(name=name, channel_count=channel_count, rate_hz=rate_hz, source=source)


class Running(Publishing):
    """The part with its outlets."""

    def __init__(self, monkeypatch, session=None, **link):
        made = []

        def outlet(info, max_buffered):
            made.append(Outlet(info, max_buffered))
            return made[-1]

        library = SimpleNamespace(
            StreamInfo=stream_info,
            StreamOutlet=outlet,
            local_clock=lambda: 0.0,
            IRREGULAR_RATE=0.0,
            cf_float32=1,
            cf_string=3,
        )
        monkeypatch.setattr(lsl_streams, "load_pylsl", lambda: library)
        monkeypatch.setattr(lsl, "require", lambda _: None)
        monkeypatch.setattr(publishing, "clock_ahead_ns", lambda _: AHEAD_NS)
        tables = {"link": link, "lsl": {"chunk_ms": 1}, "session": session or {}}
        super().__init__(LslPart, LeaderParts(), **tables)
        self.frames, *self.faster, self.events = made


@pytest.fixture
def running(monkeypatch):
    made = Running(monkeypatch)
    made.part.begin()
    yield made
    made.frames.holding.set()
    made.part.close()


def test_stamps_are_the_followers_by_the_leaders_clock_by_that_of_lsl(running):
    frames = made_frames(10, 40)
    gap = np.delete(frames, slice(10, 25))
    running.remote.clock_offset_ns = None
    running.send(made_frames(0, 7))  # before the clock is known, they are only counted
    running.remote.clock_offset_ns = OFFSET_NS
    running.send(gap[:5])
    running.send(gap[5:])
    assert running.end() == {"frames": 25, "events": 1, "dropped": 0, "unstamped": 7, "error": None}
    assert running.part.faults() == []
    stamps_s, values = zip(*running.frames.samples, strict=True)
    expected_ns = gap["time_ns"] - OFFSET_NS + AHEAD_NS
    assert list(stamps_s) == (expected_ns / 1e9).tolist()
    for column, field in (0, "position_mm"), (3, "force_n"), (6, "acceleration_m_s2"):
        found = np.array(values, np.float32)[:, column : column + 3]
        np.testing.assert_array_equal(found, gap[field])
    info = running.frames.info
    assert (info["name"], running.events.info["name"]) == ("mmt-frames", "mmt-events")
    assert info["rate_hz"] == 1000.0
    assert info["unit"] == ["mm"] * 3 + ["N"] * 3 + ["m/s2"] * 3
    assert info["label"][:4] == ["position_x_mm", "position_y_mm", "position_z_mm", "force_x_n"]
    assert info["source"] != running.events.info["source"]


def test_several_samples_of_acceleration_a_frame_have_a_stream_of_their_own(monkeypatch):
    running = Running(monkeypatch, {"acceleration_rate_hz": 5000})
    running.part.begin()
    (faster,) = running.faster
    named = [(outlet.info["name"], outlet.info["rate_hz"]) for outlet in (running.frames, faster)]
    assert named == [("mmt-frames", 1000.0), ("mmt-acceleration", 5000.0)]
    frames = made_frames(10, 40, samples_per_frame=5)
    running.send(frames)
    assert running.end()["frames"] == 40
    shift_ns = AHEAD_NS - OFFSET_NS
    slow_s, slow = zip(*running.frames.samples, strict=True)
    assert list(slow_s) == ((frames["time_ns"] + shift_ns) / 1e9).tolist()
    expected = np.concatenate([frames["position_mm"], frames["force_n"]], axis=1)
    np.testing.assert_array_equal(np.array(slow, np.float32), expected)
    fast_s, fast = zip(*faster.samples, strict=True)
    first_ns = 9_200_000 + shift_ns
    assert list(fast_s) == (np.arange(first_ns, first_ns + 40_000_000, 200_000) / 1e9).tolist()
    np.testing.assert_array_equal(np.array(fast, np.float32), acceleration_samples(frames))


def test_a_follower_that_was_started_anew_is_stamped_by_its_own_clock(running):
    frames = made_frames(500, 4)  # numbered on, its times with them
    running.send(frames, follower_time_ns=77_003_000_000)
    running.end()
    own_ns = np.arange(77_000_000_000, 77_004_000_000, 1_000_000)
    expected_s = (own_ns - OFFSET_NS + AHEAD_NS) / 1e9
    assert [stamp_s for stamp_s, _ in running.frames.samples] == expected_s.tolist()


def test_a_clock_that_is_never_compared_is_a_fault(monkeypatch):
    made = Running(monkeypatch, clock_hz=0)
    made.part.begin()
    made.remote.clock_offset_ns = None
    made.send(made_frames(1, 1))
    (fault,) = made.part.faults()
    assert "clock_hz of [link] is 0" in fault
    made.end()


def test_a_library_that_stands_still_holds_nothing_up_and_the_newest_are_kept(running):
    running.frames.holding.clear()
    running.send(made_frames(0, 2))
    assert running.frames.arrived.wait(30)
    blocks = publishing.QUEUE_LIMIT + 50
    for number in range(blocks):  # it returns although nothing is taken
        running.send(made_frames(2 + number, 1))
    running.frames.holding.set()
    figures = running.end()
    assert (figures["dropped"], figures["frames"]) == (50, 2 + publishing.QUEUE_LIMIT)
    newest_ns = made_frames(1 + blocks, 1)["time_ns"][0] - OFFSET_NS + AHEAD_NS
    assert running.frames.samples[-1][0] == newest_ns / 1e9


def test_a_library_that_fails_is_told_once_and_the_session_goes_on(running):
    running.frames.broken = True
    running.send(made_frames(0, 5))
    until(lambda: running.part.error)
    running.send(made_frames(5, 5))
    running.part.poll()
    running.part.poll()
    (sentence,) = running.said
    assert "[lsl] has failed: an internal error has occurred: the session goes on" in sentence
    assert running.part.faults() == ["[lsl] has failed: an internal error has occurred"]
    figures = running.end()
    assert (figures["frames"], figures["dropped"]) == (0, 10)
    assert figures["error"] == running.part.error


def test_events_are_markers_at_the_moment_at_which_they_are_told(running):
    before_ns = time.monotonic_ns()
    running.session.journal.event("the model is ready", samples=3)
    running.session.journal.record({"event": "clocks compared"})
    after_ns = time.monotonic_ns()
    assert running.end()["events"] == 3
    compared, ready, clocks = running.events.samples
    assert json.loads(compared[1])["lsl_clock_ahead_ns"] == AHEAD_NS
    said = {"time_s": 1.25, "event": "the model is ready", "samples": 3}
    assert json.loads(ready[1]) == said
    assert json.loads(clocks[1])["event"] == "clocks compared"
    for stamp_s, _ in (ready, clocks):
        assert before_ns <= round(stamp_s * 1e9) - AHEAD_NS + 2000
        assert round(stamp_s * 1e9) - AHEAD_NS - 2000 <= after_ns


def test_the_clocks_are_compared_by_the_quickest_look(monkeypatch):
    """Looks that were interrupted, by up to 9 ms, do not count."""
    now_ns = 1_000_000_000
    delays_ns = iter([9, 4, 7, 1, 8, 3, 6, 2, 5])

    def clock_s():
        nonlocal now_ns
        there_ns = now_ns + AHEAD_NS
        now_ns += next(delays_ns) * 1_000_000
        return there_ns / 1e9

    monkeypatch.setattr(publishing.time, "monotonic_ns", lambda: now_ns)
    assert clock_ahead_ns(clock_s) == AHEAD_NS - 500_000


@pytest.mark.parametrize(("step_ns", "followed"), [(-3600 * 10**9, True), (10**6, False)])
def test_a_clock_that_is_set_in_mid_session_is_followed(running, monkeypatch, step_ns, followed):
    monkeypatch.setattr(publishing, "clock_ahead_ns", lambda _: AHEAD_NS + step_ns)
    running.part.poll()
    running.part.poll()
    running.send(made_frames(0, 1))
    running.end()
    ahead_ns = AHEAD_NS + step_ns * followed
    (stamp_s, _) = running.frames.samples[0]
    measured_ns = int(made_frames(0, 1)["time_ns"][0]) - OFFSET_NS
    assert round(stamp_s * 1e9) == pytest.approx(measured_ns + ahead_ns, abs=2000)
    compared = [json.loads(text) for _, text in running.events.samples]
    assert [each["lsl_clock_ahead_ns"] for each in compared[1:]] == [ahead_ns] * followed


def test_a_missing_package_and_a_missing_library_are_explained(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "pylsl"]:
        monkeypatch.delitem(sys.modules, name)
    (tmp_path / "pylsl.py").write_text(
        "raise RuntimeError('LSL binary library file was not found')"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match=r"was not found\); on Linux .* PYLSL_LIB"):
        load_pylsl()
    monkeypatch.setitem(sys.modules, "pylsl", None)
    scene = scene_from_tables({"link": {}, "simulated": {}, "hand": {}, "lsl": {}})
    with pytest.raises(InputError, match=r"\[lsl\] needs pylsl, which is not .*\[lsl\]"):
        LslPart.build(Session(scene), LeaderParts())


def test_the_streams_carry_every_channel_unless_only_the_needed_ones_are_wanted():
    tables = {"link": {}, "simulated": {}, "hand": {}, "lsl": {}}
    every = ("position", "force", "acceleration")
    assert scene_from_tables(tables).channels() == every
    tables["lsl"] = {"channels": "needed"}
    assert scene_from_tables(tables).channels() == every, "nothing else needs any"
    tables["force_feedback"] = {"method": "streamed"}
    assert scene_from_tables(tables).channels() == ("force",)
    with pytest.raises(InputError, match=r"\[lsl\] needs a follower: add \[link\]"):
        scene_from_tables({"hand": {}, "lsl": {}})
