"""Contact and force of a hand whose handle measures none: assumed, streamed, then learned."""

import numpy as np
import pytest

from mmt.contact.estimation import ContactModel, EstimationSettings
from mmt.contact.rendering import HandContact
from mmt.core.frames import CONTACT_DTYPE, empty_frames
from mmt.devices.protocols import InterfaceState
from mmt.leader.motion.hand_contact import FollowerContact
from mmt.leader.part import Session
from mmt.scene import ForceFeedback, Link, Scene, Texture

STATE = InterfaceState((7.0, 8.0, 9.0), (1.0, 2.0, 3.0), 0.0, False)


def felt(contact, y_mm, shared=None):
    state = contact.state_of(STATE, (50.0, y_mm, 60.0), shared)
    assert state[:2] == STATE[:2]
    assert state.force_n > 0.0 or not state.contact
    return state.force_n if state.contact else -state.force_n


def made(told, **tables):
    scene = Scene.model_construct(texture=Texture(normal="y"), **tables)
    return FollowerContact(Session(scene, told.append), 2.0)


def test_without_a_follower_the_surface_is_at_zero_or_where_another_leader_says():
    contact = made([])
    assert [felt(contact, y_mm) for y_mm in (1.0, -2.0)] == pytest.approx([0.0, 4.0])
    assert felt(contact, -3.0, ContactModel(1e-3, 500.0)) == pytest.approx(1.0)


def test_the_followers_force_is_the_hands_until_the_contact_is_learned():
    told = []
    feedback = ForceFeedback(method="model", contact_n=1.0)
    contact = made(told, link=Link(), force_feedback=feedback)
    model = HandContact(EstimationSettings(contact_n=1.0))
    assert felt(contact, -1.0) == 0.0
    for force_n, shown in ((-3.0, 0.0), (0.0625, 0.0625), (0.03125, -0.03125)):
        frames = empty_frames(3)
        frames["force_n"] = [(9.0, 9.0, 9.0), (9.0, 9.0, 9.0), (9.0, force_n, 9.0)]
        contact.on_frames(frames)
        contact.on_frames(empty_frames(1, ["position"]))
        assert felt(contact, -1.0) == shown
    assert contact.summary == {}
    assert told == []
    records = np.zeros(2000, CONTACT_DTYPE)
    records["sequence"] = np.arange(2000)
    depth_mm = 3.0 * np.sin(np.arange(2000) / 60.0)
    records["command_mm"][:, 1] = -1.0 - depth_mm
    records["position_mm"][:, 1] = -1.0 - 0.5 * depth_mm
    records["force_n"][:, 1] = 1.5 * np.maximum(depth_mm, 0.0)
    contact.on_records(records)
    for record in records:
        command, place, force = (record[name].tolist()[1] for name in records.dtype.names[-3:])
        model.update(-1e-3 * command, -1e-3 * place, force)
    for y_mm in (-3.0, -1.5, 1.0):
        assert felt(contact, y_mm) == model.force_n(-1e-3 * y_mm)
    (sentence,) = told
    found = contact.summary
    assert found["surface_mm"] == pytest.approx(-1.0, abs=0.02)
    assert found["stiffness_n_mm"] == pytest.approx(1.5, rel=0.05)
    assert all(f"{value:g} " in sentence for value in found.values())
