"""What was no measurement, in seconds and in words, and its way into an update of a model."""

import re
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stream_samples import stroke_frames

from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.updates import SurfaceStatement
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.aligned import SignalFaults
from mmt.texture.surfaces.modeller import SurfaceModeller

CAUSES = [field.name for field in fields(SignalFaults) if field.name.endswith("_s")]


def stroke(samples, seed=1):
    return stroke_frames(np.random.default_rng(seed).standard_normal(samples))


def test_only_causes_that_occurred_are_said_with_their_seconds():
    assert SignalFaults().sentence() == ""
    found = SignalFaults(held_s=0.4, saturated_s=0.1)
    assert found.sentence() == "the accelerometer held one value for 0.4 s, was saturated for 0.1 s"
    lost = SignalFaults(missing_s=0.012, not_finite_s=1.5, bridged_s=0.004)
    assert lost.sentence() == (
        "frames were missing for 0.012 s, not finite for 1.5 s; 0.004 s of this filled in"
    )
    both = SignalFaults(constant_s=0.25, missing_s=1.0)
    assert both.sentence() == (
        "the accelerometer gave one value from the start for 0.25 s; frames were missing for 1 s"
    )
    dead = SignalFaults(constant_s=18.0, throughout=True)
    assert dead.sentence() == "the accelerometer gave one value throughout"


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("seconds", [1e-4, 0.9999, 99.96, 999.6, 123456.7])
def test_each_cause_is_said_to_three_digits_at_any_size(cause, seconds):
    """A sentence that leaves a cause out, or rounds it to nothing, fails."""
    found = SignalFaults(**{cause: seconds})
    sentence = found.sentence()
    assert found.as_dict() == {**dict.fromkeys(CAUSES, 0.0), cause: seconds, "text": sentence}
    said = [float(number) for number in re.findall(r"(\S+) s\b", sentence)]
    assert said == [pytest.approx(seconds, rel=0.005)]
    assert not re.search(r"\de", sentence)


@given(
    cause=st.sampled_from(["held_s", "saturated_s", "constant_s", "not_finite_s"]),
    parts_s=st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=200),
)
def test_a_fault_is_told_when_it_begins_and_at_each_doubling(cause, parts_s):
    """Never late by more than half of it, and in few sentences however long it lasts."""
    said, sentences = SignalFaults(), 0
    for total_s in np.cumsum(parts_s).tolist():
        now = SignalFaults(missing_s=5.0, **{cause: total_s})
        if now.should_report(said):
            said, sentences = now, sentences + 1
        assert getattr(said, cause) > 0.5 * total_s
    assert sentences <= 1 + np.log2(sum(parts_s) / parts_s[0])


def test_lost_frames_and_what_was_said_of_the_whole_time_are_not_told_again():
    assert not SignalFaults(missing_s=3.0).should_report(SignalFaults())
    dead = SignalFaults(constant_s=1.0, throughout=True)
    assert dead.should_report(SignalFaults())
    assert not SignalFaults(constant_s=9.0, throughout=True).should_report(dead)
    assert SignalFaults(constant_s=9.0, held_s=0.1).should_report(dead)


def test_faults_are_of_the_whole_stream_where_surfaces_are_told_apart():
    """A model's own filter lacks the frames of other surfaces: those are not missing."""
    frames = stroke(6000)
    frames["acceleration_m_s2"][1000:1300, 2] = frames["acceleration_m_s2"][1000, 2]
    settings = ModellingSettings(surfaces=SurfaceSettings())
    alone = OnlineModeller(ModellingSettings()).update(frames).faults
    modeller = SurfaceModeller(settings, 500)
    modeller.state_surface(SurfaceStatement(2000, 2))
    modeller.state_surface(SurfaceStatement(4000, 1))
    updates = [modeller.update(part) for part in np.array_split(frames, 12)]
    last = updates[-1]
    assert last.surface == 1
    assert last.faults == alone
    assert last.faults.missing_s == 0.0
    assert last.faults.held_s > 0.25
