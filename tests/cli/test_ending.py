"""What a person reads at the end of a run: the few lines that matter, and what was unusual."""

import copy
from pathlib import Path
from typing import Any

import pytest

from mmt.cli.ending import ending_lines, unusual
from mmt.texture.signals.faults import SignalFaults

LEADER: dict[str, Any] = {
    "outcome": "completed",
    "session": {"name": "demo", "id": "68f96b578b83", "duration_s": 18.003},
    "link": {"frames": 18003, "dropped": 0, "lost": 0, "rejected": {}, "clock": {"jumps": 0}},
    "texture": {
        "samples": 19,
        "start_s": 4.0,
        "stop_s": 9.0,
        "dropped_frames": 0,
        "tasks": {"fitting": {"items": 9, "drops": 0}},
    },
    "vibration": {"actuator": {"samples": 18005, "clipped": 0}, "playout": {"resyncs": 0}},
    "ticks": {"ticks": 19306, "missed": 12, "late_share_1ms": 0.003},
    "recording": {"file": "mmt-demo/session.mcap", "frames": 18003, "dropped": 0, "error": None},
}
FOLLOWER: dict[str, Any] = {
    "outcome": "leader stopped (completed)",
    "link": {"frames": 18003, "dropped": 0, "lost": 0},
    "ticks": {"ticks": 18003, "late_share_1ms": 0.002},
    "commands": {"silences": 0, "halts": 0, "slowed_ticks": 81},
    "backfill": {"kept": 10000, "asked": 0, "sent": 0, "gone": 0},
    "devices": {},
}
EVALUATION: dict[str, Any] = {
    "session": "demo",
    "surface": "plastic",
    "basis": "truth",
    "basis_reason": "the known texture plastic",
    "start_s": 4.0,
    "stop_s": 9.0,
    "at_stop": {"power_error_db": 0.483312, "within_jnd": 0.979167, "plane_within_jnd": 0.9},
    "at_end": {"power_error_db": 0.4, "within_jnd": 1.0, "plane_within_jnd": 1.0},
}


def leader(**changes: Any) -> dict[str, Any]:
    """Return a leader's summary, with these keys (``table__key``) changed."""
    summary = copy.deepcopy(LEADER)
    for name, value in changes.items():
        *tables, key = name.split("__")
        table = summary
        for each in tables:
            table = table.setdefault(each, {})
        table[key] = value
    return summary


def test_a_demo_ends_with_six_lines() -> None:
    lines = ending_lines(
        {"leader": LEADER, "follower": FOLLOWER}, EVALUATION, Path("mmt-demo/report.html")
    )
    assert lines == [
        "outcome:   completed after 18.0 s",
        "model:     ready at 4.0 s, complete at 9.0 s, from 19 samples",
        "error:     0.5 dB, within one JND on 98 % of the strokes made and 90 % of the whole "
        "plane, against the known texture plastic",
        "frames:    18003, 0 missing",
        "files:     mmt-demo/session.mcap, mmt-demo/report.html",
        "next:      open mmt-demo/report.html; mmt session view mmt-demo/session.mcap shows each "
        "moment; --verbose shows all counters",
    ]


def test_a_follower_says_how_it_ended_and_what_it_sent() -> None:
    assert ending_lines({"follower": FOLLOWER}) == [
        "outcome:   leader stopped (completed)",
        "frames:    18003 sent",
        "next:      --verbose shows all counters",
    ]


def test_a_criterion_that_was_not_met_is_named() -> None:
    lines = ending_lines({"leader": leader(texture__stop_s=None)})
    assert "model:     ready at 4.0 s, never complete, from 19 samples" in lines
    lines = ending_lines({"leader": leader(texture__start_s=None, texture__stop_s=None)})
    assert "model:     never ready: the start criterion was not met, from 19 samples" in lines


def test_a_run_without_model_or_link_says_nothing_of_them() -> None:
    summary = {name: LEADER[name] for name in ("outcome", "session", "ticks")}
    assert ending_lines({"leader": summary}) == [
        "outcome:   completed after 18.0 s",
        "next:      --verbose shows all counters",
    ]


def test_each_surface_has_its_error() -> None:
    two = [{**EVALUATION, "session": f"surface {number}"} for number in (1, 2)]
    lines = ending_lines({"leader": LEADER}, {"sessions": two})
    errors = [line for line in lines if "dB" in line]
    assert [line.split(":")[1].strip() for line in errors] == ["surface 1", "surface 2"]


def test_where_the_texture_is_not_known_the_error_is_of_held_out_segments() -> None:
    (line,) = (
        line
        for line in ending_lines({"leader": LEADER}, {**EVALUATION, "basis": "held-out"})
        if "dB" in line
    )
    assert line.endswith("within one JND on 98 % of the held-out segments")


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("link__lost", 3, "3 frames or commands lost on the way"),
        ("link__rejected", {"stale": 2}, "2 messages rejected (stale)"),
        ("link__clock__jumps", 1, "1 jump of the other side's clock"),
        ("texture__tasks__fitting__drops", 4, "4 items dropped before fitting: it was too slow"),
        ("vibration__actuator__clipped", 9, "9 samples clipped at the actuator's limit"),
        ("ticks__late_share_1ms", 0.073, "7 % of the ticks over 1 ms late"),
        ("recording__dropped", 5, "5 frames not recorded: the disk was too slow"),
        (
            "recording",
            {"file": "a.mcap", "frames": 9, "dropped": 5, "error": "disk full"},
            "the recording failed: disk full; 5 frames are not in it",
        ),
        (
            "texture__faults",
            SignalFaults(constant_s=18.0, throughout=True).as_dict(),
            "not measured: the accelerometer gave one value throughout",
        ),
        ("handle__losses", 1, "1 loss of the handle"),
        ("handle__faults", {"stale commands": 2}, "2 faults of the handle (stale commands)"),
    ],
)
def test_what_is_unusual_is_named(key: str, value: Any, sentence: str) -> None:
    assert unusual("leader", LEADER) == []
    assert unusual("leader", leader(**{key: value})) == [f"leader: {sentence}"]
    lines = ending_lines({"leader": leader(**{key: value})})
    assert f"unusual:   leader: {sentence}" in lines


@pytest.mark.parametrize("texture", [None, {}, {"faults": None}])
def test_a_leader_without_a_model_has_no_faults_of_its_signals(texture: Any) -> None:
    assert unusual("leader", {**LEADER, "texture": texture}) == []
    found = {"faults": SignalFaults().as_dict()}
    assert unusual("leader", {**LEADER, "texture": found}) == []


def test_a_recording_that_failed_is_to_be_recovered_before_it_is_viewed() -> None:
    lines = ending_lines({"leader": leader(recording__error="disk full")})
    recover = "mmt session recover mmt-demo/session.mcap saves what was written"
    assert lines[-1] == f"next:      {recover}; --verbose shows all counters"


def test_a_followers_devices_are_named_one_by_one() -> None:
    lost = {**FOLLOWER, "devices": {"robot": {"class": "Arm", "losses": 2}}}
    assert unusual("follower", lost) == ["follower: 2 losses of the robot"]


def test_frames_that_were_missing_are_told_with_what_became_of_them() -> None:
    gaps = {"missing": 12, "filled": 9, "lost": 3, "waiting": 0, "unwanted": 0}
    summary = {**LEADER, "link": {**LEADER["link"], "lost": 12}, "backfill": gaps}
    lines = ending_lines({"leader": summary})
    assert "frames:    18003 in time, 12 missing: 9 filled in, 3 lost" in lines
    unusual_lines = [line for line in lines if line.startswith("unusual")]
    assert unusual_lines == ["unusual:   leader: 3 frames missing and never filled in"]
