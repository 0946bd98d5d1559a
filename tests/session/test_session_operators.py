"""Who moved the robot of a recording and who listened, by its events."""

import json

import pytest
from command_runs import output_of

import mmt
from mmt.cli import sessions
from mmt.cli.common import Terminal
from mmt.evaluation.reports import tables
from mmt.session.files import read_session, write_session
from mmt.session.info import info
from mmt.session.mcap.index import IndexedSession
from mmt.session.operators import ControlPeriod, control_periods, control_sentence
from mmt.session.recorder import McapRecorder
from mmt.session.stream import open_recording


def event(time_s, control, operator="ann"):
    return {"time_s": time_s, "event": "a sentence", "control": control, "operator": operator}


HANDED = [
    event(0.5, "asked"),
    event(1.0, "giving"),
    event(1.1, "moves"),
    event(2.0, "asked", "bob"),
    event(3.0, "ended"),
    event(3.0, "giving", "bob"),
    event(3.2, "moves", "bob"),
    event(4.5, "ended", "bob"),
    {"time_s": 4.6, "event": "a sentence", "control": "back"},
]
PERIODS = (
    ControlPeriod("own", None, 0.0, 1.0),
    ControlPeriod("held", None, 1.0, 1.1),
    ControlPeriod("given", "ann", 1.1, 3.0),
    ControlPeriod("held", None, 3.0, 3.2),
    ControlPeriod("given", "bob", 3.2, 4.5),
    ControlPeriod("held", None, 4.5, 4.6),
    ControlPeriod("own", None, 4.6, 6.0),
)


def test_every_moment_belongs_to_one_hand_or_to_none():
    assert control_periods(HANDED, 6.0) == PERIODS
    assert control_sentence(PERIODS) == (
        "Hands that moved the robot: the leader's for 2.4 s, none for 0.4 s, listener ann for "
        "1.9 s, listener bob for 1.3 s."
    )
    # a recording that ends while control is away ends with that hand
    assert control_periods(HANDED[:3], 2.5)[-1] == ControlPeriod("given", "ann", 1.1, 2.5)
    # who was given control and never moved is no operator
    periods = control_periods([event(1.0, "giving"), event(2.0, "ended"), event(2.1, "back")], 3.0)
    assert [period.state for period in periods] == ["own", "held", "own"]


@pytest.mark.parametrize("events", [[], [event(1.0, "asked"), event(2.0, "refused")]])
def test_without_a_hand_over_nothing_is_said(events):
    assert control_periods(events, 3.0) == ()
    assert control_sentence(()) == ""


def test_malformed_events_make_no_impossible_period():
    odd = [
        event(1.0, ["giving"]),
        event(float("nan"), "giving"),
        event("soon", "giving"),  # as a file may have it
        event(-5.0, "moves", "\x1b[31m"),
        event(99.0, "ended"),
    ]
    periods = control_periods(odd, 3.0)
    assert [(period.from_s, period.to_s) for period in periods] == [(0, 0), (0, 0), (0, 3), (3, 3)]
    assert "\x1b" not in control_sentence(periods)


def test_evaluation_and_info_say_who_operated_and_judge_all_strokes_alike(tmp_path):
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=6.0)
    scene = {**mmt.Scene().dump(), "texture": {"order": 8}}
    given = {"link": {}, "simulated": {}, "hand": {}, "sharing": {}, "control": {}}
    alone, shared = tmp_path / "alone.mcap", tmp_path / "shared.mcap"
    write_session(alone, frames, scene=scene | given, annotations=truth)
    write_session(shared, frames, scene=scene | given, annotations=truth, events=HANDED)
    assert isinstance(open_recording(shared), IndexedSession)

    figures = []
    for path, periods in ((alone, []), (shared, [period.as_dict() for period in PERIODS])):
        written = tmp_path / "written.json"
        said = " ".join(output_of("evaluate", path, "--json", written).split())
        assert ("listener ann for 1.9 s" in said) == bool(periods)
        content = json.loads(written.read_text("utf-8"))
        assert content.pop("control") == periods
        for step in [*content["steps"], content["at_end"]]:
            del step["update_ms"]
        figures.append([content[name] for name in ("steps", "at_end", "coverage", "held_out")])
        said = output_of("session", "info", path, "--json", written)
        assert ("none for 0.4 s" in " ".join(said.split())) == bool(periods)
        assert json.loads(written.read_text("utf-8"))["control"] == periods
    assert figures[0] == figures[1]

    evaluation = mmt.evaluate_session(read_session(shared))
    assert tables.control(evaluation).rows[2] == ["listener ann", "1.10", "3.00"]


ANN = {"id": 1, "name": "[red]ann", "listened_s": 12.5, "lag_p50_ms": 21.0, "lag_p99_ms": 40.0}
SENT = {"wholes": 1, "wholes_bytes": 4000, "changes": 5, "changes_bytes": 3000, "skipped": 2}
EVENTS = [
    {"kind": "listener joined", "listener": {"id": 1, "name": "[red]ann"}},
    {"kind": "listener joined", "listener": {"id": 2, "name": ""}},
    {"kind": "listener left", "listener": {**ANN, **SENT, "why": "it disconnected"}},
    {"kind": "listener left", "listener": "malformed"},
    {"kind": "listener joined", "listener": {"id": [], "name": "odd"}},
]


def recorded(path, events):
    recorder = McapRecorder(path, channels=("force",), scene={}, session_id="abc")
    for number, event in enumerate(events):
        recorder.record_event({"time_s": float(number), "event": "a sentence", **event})
    recorder.close()
    return path


def shown(path, monkeypatch):
    console = Terminal(markup=False, emoji=False, width=200, record=True)
    monkeypatch.setattr(sessions, "output", console)
    output_of("session", "info", path)
    return console.export_text()


def test_a_recording_has_who_listened(tmp_path, monkeypatch):
    path = recorded(tmp_path / "shared.mcap", EVENTS)
    ann, stays, odd = info(path).listeners
    assert ann == {**ANN, **SENT, "why": "it disconnected"}
    assert (stays, odd) == ({"id": 2, "name": ""}, {"id": [], "name": "odd"})
    text = shown(path, monkeypatch)
    line = next(line for line in text.splitlines() if "[red]ann" in line)
    assert "\\" not in line
    for cell in ("12.5", "21", "40", "it disconnected", " 7 "):  # 7 kB
        assert cell in line
    assert "listeners" in [line.strip() for line in text.splitlines()]
    assert "listener 2" in text


def test_without_listeners_nothing_is_said_of_them(tmp_path, monkeypatch):
    path = recorded(tmp_path / "alone.mcap", [])
    assert info(path).listeners == ()
    assert "listeners" not in [line.strip() for line in shown(path, monkeypatch).splitlines()]
