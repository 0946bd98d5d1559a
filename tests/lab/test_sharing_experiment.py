"""`mmt lab sharing`: what it makes of a session and of what the listeners have found."""

import json

import pytest

from mmt.core.errors import InputError, MmtError
from mmt_lab.experiments import sharing
from mmt_lab.sharing.counting import ListenerCounts


def found(first_s, lags_ms, problem=""):
    return ListenerCounts(first_s, lags_ms, number=8 if lags_ms else 0, problem=problem)


def leader(tick_ms):
    sent = {"wholes": 2, "wholes_bytes": 11_000, "changes": 4, "changes_bytes": 2400}
    return {
        "sharing": {"sent": sent, "models": 8},
        "texture": {"stop_s": 4.0},
        "ticks": {"period_p99_ms": tick_ms},
    }


def sessions(monkeypatch, crowd, ticks_ms):
    """Let sessions end with these ticks, in turn with one listener and with the crowd."""
    waiting_ms = iter(ticks_ms)

    async def session(_, listeners):
        return leader(next(waiting_ms)), crowd[:listeners]

    monkeypatch.setattr(sharing, "run_with_listeners", session)


def test_the_figures_are_those_of_the_crowd_and_fit_into_json(monkeypatch):
    sessions(monkeypatch, [found(0.1, [10.0, 20.0]), found(0.3, [30.0])], (1.0, 1.25))
    findings = sharing.run(18.0, listeners=2, pairs=1)
    figures = json.loads(json.dumps(findings.as_dict()))["figures"]
    assert figures["tick_p99_ratio"] == 1.25
    assert (figures["joined"], figures["behind"], figures["rejected"]) == (2, 0, 0)
    assert figures["model_bytes"] == 5500.0
    assert figures["change_bytes_a_second"] == 1200.0
    assert (figures["first_p50_s"], figures["lag_p50_ms"]) == (pytest.approx(0.2), 20.0)
    missed = [target.what for target in findings.targets if not target.met]
    assert missed == ["leader's tick, p99, over that with one listener"]


def test_the_ticks_are_compared_within_pairs_and_over_them_by_the_median(monkeypatch):
    sessions(monkeypatch, [found(0.1, [10.0])] * 2, (1.0, 1.5, 2.0, 2.2, 1.0, 1.2))
    figures = sharing.run(18.0, listeners=2, pairs=3).figures
    names = ("tick_p99_ratio_least", "tick_p99_ratio", "tick_p99_ratio_most")
    assert [figures[name] for name in names] == pytest.approx([1.1, 1.2, 1.5])


def test_pairs_of_sessions_through_hubs_are_refused():
    with pytest.raises(InputError, match="--pairs does not go with --hubs"):
        sharing.run(pairs=2, hubs=2)


def test_a_crowd_without_a_model_says_why(monkeypatch):
    ended = found(None, [], "the session ended before its model was ready")
    sessions(monkeypatch, [ended] * 2, (1.0, 1.0))
    with pytest.raises(MmtError, match=r"no listener had a model .*: the session ended before"):
        sharing.run(18.0, listeners=2, pairs=1)
