"""A recording that a person starts in mid-session: what it repeats of the time before."""

from frame_samples import made_frames

from mmt.leader.part import Session
from mmt.leader.recording import RecordingPart
from mmt.scene import Scene
from mmt.session.files import read_session
from mmt.session.operators import control_periods
from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse

SCENE = {"link": {}, "hand": {}, "simulated": {}, "recording": {"file": "whole.mcap"}}


def told_in(file):
    """The states of a recording's events by their kind, without their times."""
    found = {}
    for event in read_session(file).events:
        for key in ("gain", "frozen", "control"):
            if key in event:
                found[key] = {name: value for name, value in event.items() if name != "time_s"}
    return found


async def test_a_later_recording_tells_what_holds_as_one_from_the_start(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    clock_s = [0.0]
    session = Session(Scene.model_validate(SCENE), time_s=lambda: clock_s[0])
    part = RecordingPart(session)
    session.parts.add(part)
    part.begin()
    whole = part.recorder
    session.journal.event("nothing more than said")
    for share in (0.4, 0.5):
        response = ActuatorResponse(share + 0.0 * FREQUENCIES_HZ, 20.0)
        session.journal.record({"event": "actuator response", **response.as_dict()})
    session.journal.event("model frozen", frozen=True)
    for state in ("giving", "moves"):
        session.journal.event("control", control=state, operator="ann")
    clock_s[0] = 12.5
    part.recorder = None
    await part.start(tmp_path / "later.mcap")
    for clock_s[0] in (13.001, 13.5):  # the file was slow to make
        part.on_frames(made_frames(0, 1, session.scene.channels()), 0)
    session.journal.event("marked")
    part.close()
    whole.close()
    later = read_session(tmp_path / "later.mcap")
    assert told_in("later.mcap") == told_in("whole.mcap")
    assert len(told_in("later.mcap")) == 3
    assert [period.operator for period in control_periods(later.events, 20.0)] == [None, "ann"]
    assert later.events[-2]["event"].startswith("recording into")
    assert later.events[-1] == {"event": "marked", "time_s": 0.5}
    assert "nothing more than said" not in [event["event"] for event in later.events]
