"""Listeners in a recording, and what is said of them."""

from typer.testing import CliRunner

from mmt.cli import sessions
from mmt.cli.common import Terminal
from mmt.session.info import info
from mmt.session.recorder import McapRecorder

ANN = {"id": 1, "name": "[red]ann", "listened_s": 12.5, "lag_p50_ms": 21.0, "lag_p99_ms": 40.0}
SENT = {"wholes": 1, "wholes_bytes": 4000, "changes": 5, "changes_bytes": 3000, "skipped": 2}
EVENTS = [
    {"kind": "listener joined", "listener": {"id": 1, "name": "[red]ann"}},
    {"kind": "listener joined", "listener": {"id": 2, "name": ""}},
    {"kind": "listener left", "listener": {**ANN, **SENT, "why": "it disconnected"}},
    {"kind": "listener left", "listener": "malformed"},
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
    assert CliRunner().invoke(sessions.app, ["info", str(path)]).exit_code == 0
    return console.export_text()


def test_a_recording_has_who_listened(tmp_path, monkeypatch):
    path = recorded(tmp_path / "shared.mcap", EVENTS)
    ann, stays = info(path).listeners
    assert ann == {**ANN, **SENT, "why": "it disconnected"}
    assert stays == {"id": 2, "name": ""}
    text = shown(path, monkeypatch)
    line = next(line for line in text.splitlines() if "[red]ann" in line)
    assert "\\" not in line
    for cell in ("12.5", "21", "40", "it disconnected"):
        assert cell in line
    assert " 7 " in line  # kB
    assert "listeners" in [line.strip() for line in text.splitlines()]
    assert "listener 2" in text


def test_without_listeners_nothing_is_said_of_them(tmp_path, monkeypatch):
    path = recorded(tmp_path / "alone.mcap", [])
    assert info(path).listeners == ()
    titles = [line.strip() for line in shown(path, monkeypatch).splitlines()]
    assert "listeners" not in titles
