"""The verdict on a run that has ended, from what its services say of themselves."""

import copy

import pytest

from mmt.evaluation.reports.headlines import headlines
from mmt.evaluation.run_verdict import fault_sentences, run_verdict
from mmt.texture.signals.aligned import SignalFaults

LEADER = {
    "outcome": "completed",
    "session": {"duration_s": 18.003},
    "link": {"dropped": 0, "lost": 0, "rejected": {}, "clock": {"jumps": 0}},
    "texture": {
        "start_s": 4.0,
        "stop_s": 9.0,
        "completion": {"criterion": "uncertainty", "value": 0.96},
        "dropped_frames": 0,
        "tasks": {"fitting": {"items": 9, "drops": 0}},
    },
    "vibration": {"mode": "synthesized", "actuator": {"clipped": 0}, "playout": {"resyncs": 0}},
    "ticks": {"late_share_1ms": 0.003},
    "recording": {"file": "session.mcap", "dropped": 0, "error": None},
}
FOLLOWER = {
    "outcome": "leader stopped (completed)",
    "ticks": {"late_share_1ms": 0.002},
    "commands": {"silences": 0, "halts": 0, "slowed_ticks": 81},
    "devices": {},
}
EVALUATION = {
    "start_s": 4.0,
    "stop_s": 9.0,
    "method": "field",
    "at_stop": {"completion": 0.97, "power_error_db": 0.483312},
    "at_end": {"completion": 0.98, "power_error_db": 0.4},
}


def leader(**changes):
    """Return a leader's summary, with these keys (``table__key``) changed."""
    summary = copy.deepcopy(LEADER)
    for name, value in changes.items():
        *tables, key = name.split("__")
        table = summary
        for each in tables:
            table = table.setdefault(each, {})
        table[key] = value
    return summary


def test_a_good_run_is_told_with_its_error_and_its_readiness():
    found = run_verdict({"leader": LEADER, "follower": FOLLOWER}, EVALUATION)
    assert found.state == "running"
    assert found.parts == (
        "18.0 s",
        "from the model since 4.0 s, complete at 9.0 s",
        "error 0.5 dB",
        "96 % should feel right",
    )


def test_the_error_at_the_skin_is_told_where_the_actuator_is_known():
    at_skin = {"played_share": 0.4, "low_hz": 90.0, "power_error_db": 4.26}
    assert run_verdict({}, {**EVALUATION, "at_skin": at_skin}).error == "0.5 dB, 4.3 at the skin"
    assert run_verdict({}, {**EVALUATION, "at_skin": None}).error == "0.5 dB"


def test_a_session_that_was_evaluated_alone_is_told_likewise():
    found = run_verdict({}, EVALUATION)
    assert (found.state, found.now) == ("running", "model ready since 4.0 s, complete at 9.0 s")
    assert (found.error, found.readiness) == ("0.5 dB", "97 % should feel right")
    published = {**EVALUATION, "method": "published", "at_stop": None}
    assert run_verdict({}, published).readiness == "completion sum 1.0"


def test_of_several_surfaces_the_medians_are_told():
    errors = [0.4, 0.9, 3.0]
    sessions = [{**EVALUATION, "at_stop": {"power_error_db": error}} for error in errors]
    assert run_verdict({"leader": LEADER}, {"sessions": sessions}).error == "0.9 dB"


@pytest.mark.parametrize("complete", range(6))
def test_verdict_and_headlines_agree_on_whether_sessions_were_complete(complete):
    stops_s = [9.0] * complete + [None] * (5 - complete)
    sessions = [{**EVALUATION, "stop_s": stop_s} for stop_s in stops_s]
    found = headlines({"sessions": sessions}, {"sessions": [EVALUATION]})
    complete_at = next(each.left for each in found if each.title == "complete at (s)")
    told = "complete at 9.0 s" in run_verdict({}, {"sessions": sessions}).now
    assert told == (complete_at == "9.0") == (complete > 2)


def test_a_follower_alone_says_how_it_ended():
    found = run_verdict({"follower": FOLLOWER})
    assert (found.state, found.parts) == ("running", ("leader stopped (completed)",))


BROKEN = {"file": "a.mcap", "dropped": 5, "error": "disk full"}
DEAD = SignalFaults(constant_s=18.0, throughout=True).as_dict()
STALE = {"stale commands": 2, "jumps": 0}


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
        ("recording", BROKEN, "the recording failed: disk full; 5 frames are not in it"),
        ("texture__faults", DEAD, "not measured: the accelerometer gave one value throughout"),
        ("handle__losses", 1, "1 loss of the handle"),
        ("handle__faults", STALE, "2 faults of the handle (stale commands)"),
    ],
)
def test_what_is_unusual_is_named(key, value, sentence):
    assert fault_sentences("leader", LEADER) == []
    assert fault_sentences("leader", leader(**{key: value})) == [f"leader: {sentence}"]
    found = run_verdict({"leader": leader(**{key: value})})
    assert f"leader: {sentence}" in found.faults
    assert found.state == ("failed" if key == "recording" else "degraded")


@pytest.mark.parametrize("modelled_s", [0.0, 17.0, 18.0])
@pytest.mark.parametrize("sessions", [0, 1, 2])
def test_a_fault_of_the_signals_is_told_once(modelled_s, sessions):
    """The leader's sentence ends with its last update, that of the evaluation with the session."""
    told = leader(texture__faults=SignalFaults(constant_s=modelled_s).as_dict())
    session = {**EVALUATION, "faults": SignalFaults(constant_s=18.0).as_dict()}
    faults = run_verdict({"leader": told}, {"sessions": [session] * sessions}).faults
    assert len(faults) == (1 if sessions or modelled_s else 0)
    assert all(("18 s" in fault) == bool(sessions or modelled_s == 18.0) for fault in faults)


@pytest.mark.parametrize("texture", [None, {}, {"faults": None}])
def test_a_leader_without_a_model_has_no_faults_of_its_signals(texture):
    assert fault_sentences("leader", {**LEADER, "texture": texture}) == []
    found = {"faults": SignalFaults().as_dict(), "handle": {"faults": {"jumps": 0}}}
    assert fault_sentences("leader", {**LEADER, "texture": found}) == []


def test_faults_are_told_of_a_listener_and_of_each_device_of_a_follower():
    late = {**LEADER, "ticks": {"late_share_1ms": 0.2}, "listening": {"states": 3}}
    assert fault_sentences("leader", late) == ["listener: 20 % of the ticks over 1 ms late"]
    lost = {**FOLLOWER, "devices": {"robot": {"class": "Arm", "losses": 2, "missed_frames": 30}}}
    assert fault_sentences("follower", lost) == [
        "follower: 2 losses of the robot",
        "follower: 30 frames without a reading of the robot",
    ]


@pytest.mark.parametrize("lost", [0, 3])
def test_only_frames_that_were_never_filled_in_are_a_fault(lost):
    gaps = {"missing": 12, "filled": 12 - lost, "lost": lost, "waiting": 0, "unwanted": 0}
    summary = {**LEADER, "link": {**LEADER["link"], "lost": 12}, "backfill": gaps}
    faults = ("leader: 3 frames missing and never filled in",) if lost else ()
    assert run_verdict({"leader": summary}).faults == faults
