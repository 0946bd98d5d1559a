"""The verdict: one state and a few words from what is known of a run."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from mmt.core.verdict import Facts, has_failed, verdict

FAILED_OUTCOMES = ["failed: the disk is full", "follower failed: no device", "follower lost"]
FAILED_OUTCOMES += ["leader failed: no device", "leader lost"]
ENDED = ["completed", "source ended", "stopped", "leader stopped (completed)"]
TIMES = {"time_s": 18.0, "start_s": 3.0, "stop_s": 11.0}
READY = Facts(**TIMES, mode="synthesized", models=True, readiness=0.84, error_db=1.1, jnd_db=1.36)

shares = st.none() | st.floats(0.0, 1.0)
times = st.none() | st.floats(0.0, 1e6)
facts = st.builds(
    Facts,
    time_s=times,
    mode=st.sampled_from([None, "streamed", "fading", "synthesized", "silent", "another"]),
    start_s=times,
    stop_s=times,
    forced=st.booleans(),
    waits=st.sampled_from(["", "waiting for the follower"]),
    outcome=st.none() | st.sampled_from([*ENDED, *FAILED_OUTCOMES]),
    models=st.booleans(),
    readiness=shares,
    takes_over_at=shares,
    error_db=st.none() | st.floats(0.0, 100.0),
    skin_error_db=st.none() | st.floats(0.0, 100.0),
    played_share=shares,
    jnd_db=st.none() | st.just(1.36),
    faults=st.lists(st.sampled_from(["49 % of the ticks late", "follower lost"]), unique=True),
)


@given(facts)
def test_a_verdict_says_why_it_is_not_well_and_only_then(known):
    found = verdict(known)
    assert found.now
    assert (found.state in ("degraded", "failed")) == bool(found.faults)
    assert (found.state == "failed") == has_failed(known.outcome)
    assert (found.health == "all well") == (found.state in ("running", "waiting"))
    for fault in [*known.faults, *([known.outcome] if has_failed(known.outcome) else [])]:
        assert fault is not None
        assert fault in found.health
        assert fault in found.sentence
    if known.outcome is not None:
        assert found.state != "waiting"
        assert "needed" not in found.readiness


@given(facts)
def test_a_fault_makes_no_run_better(known):
    order = ["running", "waiting", "degraded", "failed"]
    worse = verdict(replace(known, faults=[*known.faults, "another fault"]))
    assert order.index(worse.state) >= order.index(verdict(known).state)


def test_a_good_run_is_told_in_four_words():
    found = verdict(READY)
    assert found.state == "running"
    assert found.parts == (
        "18.0 s",
        "from the model since 3.0 s, complete at 11.0 s",
        "error 1.1 dB",
        "84 % should feel right",
    )
    assert found.noticeable == "less than the 1.4 dB that are just noticeable"


def test_what_the_actuator_leaves_is_told_beside_the_models_error():
    found = verdict(replace(READY, skin_error_db=4.26, played_share=0.38))
    assert found.error == "1.1 dB, 4.3 at the skin"
    assert found.readiness == "84 % should feel right, the actuator plays 38 % of the power"
    for outcome in ENDED:
        ended = verdict(replace(READY, played_share=0.38, outcome=outcome))
        assert (ended.state, ended.readiness) == ("running", "84 % should feel right")


def test_a_model_that_never_took_over_is_told():
    found = verdict(Facts(mode="streamed", models=True, readiness=0.4, outcome="completed"))
    assert (found.state, found.now) == ("degraded", "streamed")
    assert found.health == "the model was never ready"


def test_a_lost_follower_is_told_once_and_at_once():
    waits = "follower lost: waiting 10 s for its return"
    found = verdict(replace(READY, waits=waits, faults=["follower lost"]))
    assert (found.state, found.sentence) == ("degraded", waits)
