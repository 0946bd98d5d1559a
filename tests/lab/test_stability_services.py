"""Clocks, stops and endless modelling: what holds, and that a fault would be seen."""

import numpy as np
import pytest
from extreme_cases import case_of, those_that_do_not_hold

import mmt.leader.output.stream
import mmt.texture.online.modeller
from mmt.core.frames import empty_frames
from mmt_lab.stability.families import run_case, services
from mmt_lab.stability.families.services import interrupted_cases, run_endless_modelling


def test_what_needs_no_hour_holds():
    quick = [case for case in services.cases() if "clock steps" in case.what]
    assert len(quick) == 4
    assert those_that_do_not_hold("services", quick) == []


@pytest.mark.parametrize("number", range(2))
def test_the_services_survive_what_interrupts_them(number):
    cases = interrupted_cases(6.0)
    if number >= len(cases):
        pytest.skip("this system cannot stop processes")
    row = run_case("services", cases[number])
    assert row.held, f"{row.what}: {row.got}"


SUMMARY = {"outcome": "stopped", "link": {"frames": 9000}, "backfill": {"filled": 40, "lost": 0}}


def strokes(count, speed_mm_s):
    frames = empty_frames(count)
    frames["sequence"] = np.arange(count)
    frames["position_mm"][:, 0] = 0.001 * speed_mm_s * np.arange(count)
    return frames


def test_a_frame_that_is_not_filled_in_is_seen():
    frames = strokes(3000, 100.0)
    assert services.judge_stop(SUMMARY, frames).held
    assert not services.judge_stop(SUMMARY, np.delete(frames, 1500)).held
    lost = {**SUMMARY, "backfill": {"filled": 39, "lost": 1}}
    assert not services.judge_stop(lost, frames).held


def test_a_robot_that_catches_up_too_fast_is_seen():
    assert services.judge_speed(340.0, SUMMARY, strokes(3000, 340.0)).held
    assert not services.judge_speed(340.0, SUMMARY, strokes(3000, 400.0)).held


def test_a_clock_that_is_not_watched_does_not_hold(monkeypatch):
    monkeypatch.setattr(mmt.leader.output.stream, "_CLOCK_STEP_NS", 10**15)
    cases = services.cases()
    assert not case_of(cases, "follower's clock steps by -10 s").run().held
    assert not case_of(cases, "leader's clock steps by +10 s").run().held


def test_endless_modelling_keeps_its_size(monkeypatch):
    monkeypatch.setattr(mmt.texture.online.modeller, "LARGEST_MODEL", 60)
    figures = run_endless_modelling(60).figures
    assert figures["samples"] == 60
    assert figures["growth_blocks"] < services.MOST_BLOCKS


def test_a_model_without_an_end_is_seen(monkeypatch):
    monkeypatch.setattr(mmt.texture.online.modeller, "LARGEST_MODEL", 10**9)
    outcome = run_endless_modelling(120)
    assert outcome.figures["samples"] > 300
    assert outcome.figures["growth_blocks"] > services.MOST_BLOCKS
    assert not outcome.held
