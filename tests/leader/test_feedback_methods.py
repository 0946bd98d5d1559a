"""The passive and the model method at the leader, and their parts at the follower."""

import math

import numpy as np
import pytest

from mmt.contact.passivity import PassivitySettings
from mmt.core.frames import CONTACT_DTYPE, CONTACT_GATHERED, ENERGY_DTYPE, empty_frames
from mmt.devices.protocols import InterfaceState
from mmt.follower.feedback import ContactReporter, PassiveFollower
from mmt.follower.feedback import build_feedback as follower_feedback
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.feedback_model import ModelForce
from mmt.leader.motion.feedback_part import build_feedback
from mmt.leader.motion.feedback_passive import PassiveForce
from mmt.scene import ForceFeedback
from mmt.scene.files import scene_from_tables

SETTINGS = PassivitySettings()


class Handle:
    """A display, which is not read."""

    def __init__(self):
        self.force_n = (0.0, 0.0, 0.0)

    def write(self, force_n):
        self.force_n = force_n


def at(z_mm):
    return InterfaceState((0.0, 0.0, z_mm), (0.0, 0.0, 0.0), 0.0, True)


def pushing(force_n):
    frames = empty_frames(1, ("force",))
    frames["force_n"][0, 2] = force_n
    return frames


def samples(depth_mm, stiffness_n_mm):
    records = np.zeros(len(depth_mm), dtype=CONTACT_DTYPE)
    records["sequence"] = np.arange(len(depth_mm))
    records["command_mm"][:, 2] = -depth_mm
    records["position_mm"][:, 2] = -0.5 * depth_mm
    records["force_n"][:, 2] = stiffness_n_mm * np.maximum(0.0, depth_mm)
    return records


@pytest.mark.parametrize(
    ("method", "leader", "follower"),
    [
        ("streamed", StreamedForce, type(None)),
        ("passive", PassiveForce, PassiveFollower),
        ("model", ModelForce, ContactReporter),
    ],
)
def test_a_scene_chooses_both_sides(method, leader, follower):
    table = ForceFeedback.model_validate({"method": method})
    made = build_feedback(table, Handle(), rate_hz=1000.0, normal="z")
    tables = {"link": {}, "hand": {}, "simulated": {}, "force_feedback": {"method": method}}
    other = follower_feedback(scene_from_tables(tables))
    assert type(made) is leader
    assert type(other) is follower
    assert made.summary["method"] == method
    if other is not None:
        assert made.event == other.event
        assert made.dtype == other.dtype


def test_passive_gives_back_no_more_than_the_follower_says_came_back():
    handle = Handle()
    feedback = PassiveForce(handle, limit_n=10.0, settings=SETTINGS)
    given = 0.0
    got = 0.0
    z = before = 0.0
    news = []
    for tick in range(2000):
        z = -3.0 * math.sin(tick / 100)
        got += handle.force_n[2] * 1e-3 * (z - before)
        before = z
        feedback.on_frames(pushing(4.0))
        news.append(feedback.tick(1, at(z)))
        assert math.hypot(*handle.force_n) <= 10.0 + 1e-9
    said = np.concatenate([record for record in news if record is not None])
    assert said.dtype == ENERGY_DTYPE  # what the hand put in
    assert said["energy_j"][:, 2].max() > 0.0
    assert not said["energy_j"][:, :2].any()
    assert feedback.summary["energy_given_mj"] == given
    assert got <= 1e-3 + 1e-9
    assert abs(handle.force_n[2]) < 4.0


@pytest.mark.parametrize("method", ["streamed", "passive", "model"])
def test_the_force_fades_in_silence_and_without_a_handle(method):
    handle = Handle()
    table = ForceFeedback.model_validate({"method": method})
    feedback = build_feedback(table, handle, rate_hz=1000.0, normal="z")
    feedback.on_frames(pushing(2.0))
    for _ in range(10):
        feedback.tick(1, at(0.0))
    assert handle.force_n[2] == pytest.approx(2.0)
    for _ in range(100):
        feedback.tick(1, None)
    assert handle.force_n == (0.0, 0.0, 0.0)


def test_the_model_shows_the_force_of_the_hands_own_place():
    handle = Handle()
    feedback = ModelForce(handle, limit_n=10.0)
    streamed = ModelForce(handle, limit_n=10.0)
    streamed.on_frames(pushing(1.0))
    for _ in range(5):
        streamed.tick(1, at(0.0))
    assert handle.force_n[2] == pytest.approx(1.0)  # that of the stream, until there is a model
    assert streamed.summary["surface"] == {}
    records = samples(2.0 * np.sin(np.arange(2000) / 60), 1.5)
    for start in range(0, 2000, CONTACT_GATHERED):
        feedback.on_records(records[start : start + CONTACT_GATHERED])
    for tick in range(300):  # down onto the surface, slowly
        feedback.on_frames(pushing(0.0))
        feedback.tick(1, at(1.0 - 0.01 * tick))
    assert handle.force_n[2] == pytest.approx(1.5 * 1.99, rel=0.1)
    assert feedback.contact_model.stiffness_n_m == pytest.approx(1500.0, rel=0.1)
    surface = feedback.surface
    assert surface.stiffness_n_m == pytest.approx(3000.0, rel=0.1)
    summary = feedback.summary
    assert summary["surface"]["stiffness_n_mm"] == pytest.approx(3.0, rel=0.1)
    assert summary["model_after_s"] is not None
    assert 0 < summary["contact_samples"] < 2000


def test_what_no_model_explains_is_shown_as_it_was_met_at_each_place_and_speed():
    """A surface that gives back half of its force: no spring and damper is both at once."""
    handle = Handle()
    feedback = ModelForce(handle, limit_n=10.0)
    depth = 4.0 * np.sin(np.arange(3000) / 30)
    records = samples(depth, 1.0)
    outward = np.gradient(depth) < 0.0
    records["force_n"][outward] *= 0.5
    for start in range(0, 2000, CONTACT_GATHERED):
        feedback.on_records(records[start : start + CONTACT_GATHERED])
    shown = []
    for tick in range(2000, 3000):
        feedback.on_frames(pushing(0.0))
        feedback.tick(1, at(-float(depth[tick])))
        shown.append(handle.force_n[2])
    expected = records["force_n"][2000:, 2]
    moving = np.abs(np.gradient(depth[2000:])) > 0.05  # mm a tick
    moving[:200] = False  # until the hand has paid for it
    error = np.array(shown) - expected
    for way in (outward[2000:] & moving, ~outward[2000:] & moving):
        assert np.sqrt(np.mean(error[way] ** 2)) < 0.2
    model = feedback.contact_model
    assert model is not None
    alone = [model.force_n(1e-3 * place, 0.0) for place in depth[2000:]] - expected
    assert np.sqrt(np.mean(alone[moving] ** 2)) > 0.4


def test_the_follower_holds_back_until_the_leader_pays():
    follower = PassiveFollower(SETTINGS)
    frames = empty_frames(1, ("force",))
    command = None
    for tick in range(100):
        command = follower.command((0.0, 0.0, -0.05 * tick))
        frames["force_n"][0, 2] = max(0.0, -5.0 * command[2])
        follower.measured(frames)
    assert command[2] == pytest.approx(-0.05 * 99 + 3.0)
    assert follower.summary["largest_drift_mm"] == pytest.approx(3.0)
    assert follower.command(None) is None


def test_contact_samples_go_out_gathered_with_the_command_that_they_followed():
    reporter = ContactReporter()
    frames = empty_frames(1, ("position", "force"))
    assert reporter.measured(frames) is None  # no command yet
    blocks = []
    for tick in range(2 * CONTACT_GATHERED):
        reporter.command((0.0, 0.0, -float(tick)))
        frames["sequence"], frames["force_n"][0, 2] = 7 * tick, tick
        blocks.append(reporter.measured(frames.copy()))
    sent = [block for block in blocks if block is not None]
    assert [len(block) for block in sent] == [CONTACT_GATHERED] * 2
    together = np.concatenate(sent)
    assert together["sequence"].tolist() == list(range(0, 14 * CONTACT_GATHERED, 7))
    assert (together["command_mm"][:, 2] == -together["force_n"][:, 2]).all()
