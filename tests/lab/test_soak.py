"""Faults, drift, the recording's read-back and the rows of a soak, without any service."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.frames import frame_dtype
from mmt.session.files import write_session
from mmt_lab.experiments import soak
from mmt_lab.soak.drift import by_window, drift, outside
from mmt_lab.soak.faults import CUT, LENGTHS_S, RESTART, SoakFault, plan_faults
from mmt_lab.soak.judging import (
    AppliedFault,
    Gap,
    Readback,
    ServiceSample,
    SoakLog,
    find_gaps,
    judge,
    read_back,
    table,
)


@given(duration_s=st.floats(5, 5000), every_s=st.floats(1, 60), seed=st.integers(0, 1000))
@settings(max_examples=60)
def test_faults_are_apart_bounded_and_leave_the_end_alone(duration_s, every_s, seed):
    faults = plan_faults(duration_s, every_s, seed)
    assert faults == plan_faults(duration_s, every_s, seed)
    for fault in faults:
        assert fault.length_s <= min(LENGTHS_S[fault.kind][1], 0.5 * every_s)
        assert fault.length_s >= min(LENGTHS_S[fault.kind][0], 0.5 * every_s)
        assert fault.end_s <= duration_s - every_s
        assert fault.kind != RESTART or fault.at_s <= 0.5 * duration_s
    for before, after in pairwise(faults):
        assert 0.499 * every_s <= after.at_s - before.end_s <= 1.501 * every_s


def test_an_hour_has_every_fault_many_times():
    kinds = [fault.kind for fault in plan_faults(3600.0, 20.0, 1)]
    assert len(kinds) > 120
    assert set(kinds) == set(LENGTHS_S)
    assert set(kinds[: len(LENGTHS_S)]) == set(LENGTHS_S)
    counts = [kinds.count(kind) for kind in LENGTHS_S if kind != RESTART]
    assert max(counts) - min(counts) <= 1


@given(seed=st.integers(0, 200), scale=st.sampled_from([0.01, 1.0, 100.0]))
@settings(max_examples=40)
def test_a_figure_that_stays_has_not_grown(seed, scale):
    values = 5.0 + scale * np.random.default_rng(seed).standard_normal(60)
    found = drift(60.0 * np.arange(60), values)
    assert found.within(scale)
    assert found.typical == np.median(values)


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_growth_is_found_also_among_disturbed_windows(share):
    generator = np.random.default_rng(1)
    values = 100.0 + 0.5 * np.arange(60) + generator.standard_normal(60)
    values[generator.random(60) < share] = 1000.0
    found = drift(60.0 * np.arange(60), values)
    assert found.growth == pytest.approx(0.5 * 59, rel=0.2)
    assert not found.within(15.0)
    assert found.within(60.0)


def test_too_few_windows_tell_nothing():
    found = drift(np.arange(4.0), np.array([1.0, 10.0, 100.0, 1000.0]))
    assert found.growth is None
    assert found.within(0.0)


def test_windows_hold_what_lies_in_them():
    times_s = np.array([0.1, 0.2, 0.3, 1.1, 2.1, 2.2, 2.9, 2.95])
    middles, figures = by_window(times_s, np.arange(8.0), 1.0, lambda values: float(values.sum()))
    assert middles.tolist() == [0.5, 2.5]
    assert figures.tolist() == [3.0, 4.0 + 5.0 + 6.0 + 7.0]
    kept = outside(times_s, [(-np.inf, 0.2), (2.15, 2.5)])
    assert times_s[kept].tolist() == [0.3, 1.1, 2.1, 2.9, 2.95]


def numbered(numbers):
    frames = np.zeros(len(numbers), frame_dtype())
    frames["sequence"] = numbers
    frames["time_ns"] = np.array(numbers, dtype=np.int64) * 1_000_000
    return frames


def test_gaps_repetitions_and_disorder_are_found():
    gaps, disordered = find_gaps(numbered([*range(100), *range(150, 200), 199, 150, 201]))
    assert gaps == (Gap(50, 0.099, 0.15), Gap(50, 0.15, 0.201))
    assert disordered == 2


def test_a_recording_is_read_back(tmp_path):
    frames = numbered([*range(100), *range(150, 400)])
    write_session(tmp_path / "made.mcap", frames)
    found = read_back(tmp_path / "made.mcap")
    assert (found.whole, found.frames, found.missing, found.disordered) == (True, 350, 50, 0)
    assert len(found.arrival_s) == len(found.latency_ms) == 18


def good(duration_s=600.0):
    """What a run without flaws has seen, and its recording."""
    generator = np.random.default_rng(0)
    times = np.arange(1000.0, 1000.0 + duration_s, 0.2)
    samples = [
        ServiceSample(float(t), 200.0 + generator.standard_normal(), 180.0, 70.0, 200 * i, i)
        for i, t in enumerate(times)
    ]
    killed = AppliedFault(SoakFault(RESTART, 100.0, 0.5), 1100.0, 1100.5)
    cut = AppliedFault(SoakFault(CUT, 300.0, 0.0), 1300.0, 1300.0)
    leader = {"recording": {"frames": 590_000, "dropped": 0}}
    observed = SoakLog(1000.0, 1000.0 + duration_s, [killed, cut], [1000.0], samples, leader, [])
    arrivals = np.arange(1000.0, 1000.0 + duration_s, 0.02)
    latency_ms = 1.0 + 0.1 * generator.random(len(arrivals))
    gaps = (Gap(800, 1100.0, 1100.8),)
    return observed, Readback(True, 590_000, 0, gaps, arrivals, latency_ms)


def broken(observed, readback):
    return [check.what for check in judge(observed, readback) if not check.held]


def test_a_run_without_flaws_holds():
    observed, readback = good()
    checks = judge(observed, readback)
    assert [check.what for check in checks if not check.held] == []
    assert all(check.figures.get("growth", 0.0) is not None for check in checks)
    assert len(table(checks).rows) == len(checks)


def growing(name, more):
    """Return a change by which a figure of the services grows with the time that has passed."""

    def change(observed, readback):
        samples = [
            replace(sample, **{name: getattr(sample, name) + more(i / len(observed.samples))})
            for i, sample in enumerate(observed.samples)
        ]
        return replace(observed, samples=samples), readback

    return change


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("services", lambda o, r: (replace(o, errors=["the leader ended"]), r)),
        ("recording can be read to its end", lambda o, r: (o, replace(r, whole=False))),
        ("frames in the recording", lambda o, r: (o, replace(r, frames=589_999))),
        ("frames twice or out of order", lambda o, r: (o, replace(r, disordered=1))),
        (
            "frames missing, but where a follower was killed",
            lambda o, r: (o, replace(r, gaps=(*r.gaps, Gap(1, 1200.0, 1200.002)))),
        ),
        (
            "frames missing, but where a follower was killed",  # what a cut lost is sent again
            lambda o, r: (o, replace(r, gaps=(*r.gaps, Gap(1, 1300.0, 1300.002)))),
        ),
        (
            "longest silence of the stream (s)",
            lambda o, r: (o, replace(r, arrival_s=np.append(r.arrival_s, 1640.0),
                                     latency_ms=np.append(r.latency_ms, 1.0))),
        ),
        (
            "frames, one way, p50 (ms)",
            lambda o, r: (o, replace(r, latency_ms=r.latency_ms + np.linspace(0, 1.5, 30_000))),
        ),
        ("leader's memory (MB)", growing("leader_mb", lambda share: 40.0 * share)),
        ("modelling's memory (MB)", growing("modelling_mb", lambda share: 40.0 * share)),
        ("follower's memory (MB)", growing("follower_mb", lambda share: 20.0 * share)),
        ("leader's ticks over 1 ms late (%)",
         growing("late_ticks", lambda share: round(60_000 * share**2))),
    ],
)  # fmt: skip
def test_each_flaw_is_a_row_that_does_not_hold(what, change):
    assert broken(*change(*good())) == [what]


def test_a_follower_that_was_started_anew_is_watched_in_its_longest_life():
    observed, readback = good()
    lives = [1000.0, 1200.0]
    samples = [replace(s, follower_mb=70.0 if s.time_s < 1200 else 50.0) for s in observed.samples]
    checks = judge(replace(observed, lives_s=lives, samples=samples), readback)
    (memory,) = [check for check in checks if check.what.startswith("follower")]
    assert memory.figures["typical"] == 50.0


def test_a_short_run_says_what_it_cannot_tell():
    observed, readback = good(duration_s=5.0)
    checks = judge(replace(observed, faults=[]), replace(readback, gaps=()))
    assert sum("too few" in check.found for check in checks) >= 3


def test_a_long_run_that_cannot_tell_does_not_hold():
    observed, readback = good()
    always = AppliedFault(SoakFault(CUT, 0.0, 600.0), 1000.0, 1600.0)
    assert len(broken(replace(observed, faults=[*observed.faults, always]), readback)) == 6


def test_a_soak_that_finds_a_flaw_says_so(tmp_path, monkeypatch):
    observed, _ = good()

    async def made(duration_s, faults, seed, recording):
        write_session(recording, numbered([*range(50), *range(60, 90)]))
        return observed

    monkeypatch.setattr(soak, "_run", made)
    found = soak.run(duration=60.0, every=5.0, output=tmp_path)
    flaw = "frames missing, but where a follower was killed: 10 of 10"
    assert any(flaw in sentence for sentence in found.failures)
    assert found.data["faults"][0]["kind"] == "follower killed and started anew"
