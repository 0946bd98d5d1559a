"""A handle that is lost and comes back somewhere else: commands, force and vibration."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import until

from mmt.contact.passivity import PassivitySettings
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.frames import ENERGY_DTYPE, frame_dtype
from mmt.devices.protocols import InterfaceState
from mmt.devices.reconnection import OperatorHandle
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.feedback_model import ModelForce
from mmt.leader.motion.feedback_passive import PassiveForce
from mmt.leader.motion.hand import HandPart
from mmt.leader.part import Tick

RECOVERY_MM = 0.05


class Handle:
    """A handle that can be unplugged."""

    def __init__(self):
        self.faults = {}
        self.place = (0.0, 0.0, 0.0)
        self.unplugged = None
        self.shown = (0.0, 0.0, 0.0)

    def connect(self):
        if self.unplugged is not None:
            raise MmtError(self.unplugged)

    def calibrate(self):
        pass

    def close(self):
        self.shown = (0.0, 0.0, 0.0)

    def read(self, elapsed_ticks):
        if self.unplugged is not None:
            raise DeviceLost(self.unplugged)
        return InterfaceState(self.place, (0.0, 0.0, 0.0), 0.0, False)

    def write(self, force_n):
        if self.unplugged is not None:
            raise DeviceLost(self.unplugged)
        self.shown = force_n


def made():
    device, told = Handle(), []
    handle = OperatorHandle(device, RECOVERY_MM)
    handle.watch(lambda sentence, **details: told.append((sentence, details)))
    handle.connect()
    return device, handle, told


def until_back(handle, act):
    until(lambda: not handle.lost, act)


def test_the_robot_is_held_while_the_handle_is_lost_and_then_moved_without_a_jump():
    device, handle, told = made()
    device.place = (1.0, 2.0, 3.0)
    handle.read(1)
    device.unplugged = "the cable is out"
    assert handle.read(1) is None
    assert handle.command_mm == (1.0, 2.0, 3.0)
    device.place, device.unplugged = (1.0, -1.0, 7.0), None
    until_back(handle, lambda: handle.read(1))
    commands = [handle.command_mm]
    for _ in range(120):
        state = handle.read(1)
        assert state.position_mm == device.place  # what the hand feels is where the hand is
        commands.append(handle.command_mm)
    steps = np.linalg.norm(np.diff(np.array([(1.0, 2.0, 3.0), *commands]), axis=0), axis=1)
    assert steps.max() == pytest.approx(RECOVERY_MM)
    assert commands[-1] == device.place  # 5 mm at 0.05 mm a tick
    assert [details.get("state") for _, details in told] == ["lost", "back"]
    assert "the handle (Handle) is lost: the cable is out" in told[0][0]
    assert handle.losses_summary["losses"] == 1
    assert handle.losses_summary["lost_s"] > 0.0


def test_the_hands_own_motion_comes_on_top_of_the_recovery():
    device, handle, _ = made()
    handle.read(1)
    device.unplugged = "gone"
    handle.read(1)
    device.place, device.unplugged = (50.0, 0.0, 0.0), None
    until_back(handle, lambda: handle.read(1))
    before = handle.command_mm
    device.place = (50.0, 0.0, -2.0)
    handle.read(1)
    assert handle.command_mm == pytest.approx((before[0] + RECOVERY_MM, 0.0, -2.0))


def test_reasons_that_differ_in_numbers_alone_are_told_once(monkeypatch):
    monkeypatch.setattr("mmt.devices.reconnection._RETRY_S", 0.005)
    device, handle, told = made()
    handle.read(1)
    for passed_ms in range(12, 18):
        device.unplugged = f"no answer for {passed_ms} ms"
        until(lambda: device.unplugged in (handle.problem or ""), lambda: handle.read(1))
    assert [sentence for sentence, _ in told if "not back" in sentence] == []
    device.unplugged = "put the stylus into the inkwell"
    until(lambda: len(told) >= 2, lambda: handle.read(1))
    assert told[1][0] == "the handle is not back yet: put the stylus into the inkwell"
    assert handle.problem == "the handle (Handle) is lost: put the stylus into the inkwell"
    handle.close()


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize("reconnecting", [True, False])
def test_a_reading_that_is_no_number_is_left_out(number, reconnecting):
    device, handle, _ = made()
    if reconnecting:  # the first reading after a loss sets the way back
        handle.read(1)
        device.unplugged = "the cable is out"
        handle.read(1)
        device.unplugged, device.place = None, (1.0, number, 3.0)
        until_back(handle, lambda: handle.read(1))
    commands = []
    remote = SimpleNamespace(command=lambda _, place_mm: commands.append(place_mm))
    session = SimpleNamespace(remote=remote, journal=SimpleNamespace(event=None))
    hand = HandPart(session, *((handle, handle) if reconnecting else (device,)))
    for place in ((1.0, number, 3.0), (1.0, 2.0, 3.0)):
        device.place = place
        for _ in range(100):
            hand.tick(Tick(streaming=True))
    assert np.isfinite(np.array(commands)).all()
    assert commands[-1] == (1.0, 2.0, 3.0)
    device.faults = {"stale commands": 2}
    table = hand.summary(1.0)["handle"]
    assert table["not_finite"] >= 100
    assert (table["device"], table["faults"]) == ("Handle", {"stale commands": 2})
    assert table.get("losses") == (1 if reconnecting else None)


def test_a_loss_that_only_writing_saw_moves_no_command_either():
    device, handle, _ = made()
    device.unplugged = "gone"
    assert handle.read(1) is None
    assert handle.command_mm is None  # it was never read
    device.unplugged = None
    until_back(handle, lambda: handle.read(1))
    device.unplugged = "gone"
    handle.write((0.0, 0.0, 1.0))
    assert handle.lost
    device.place, device.unplugged = (5.0, 0.0, 0.0), None
    until_back(handle, lambda: handle.write((0.0, 0.0, 0.0)))
    handle.read(1)
    assert handle.command_mm == pytest.approx((RECOVERY_MM, 0.0, 0.0))


@given(
    st.lists(st.tuples(*[st.floats(-200.0, 200.0)] * 3), min_size=2, max_size=6), st.integers(1, 40)
)
def test_no_command_jumps_wherever_the_handle_comes_back(places, elapsed):
    """Each loss is seen at once by a connection that is done at once."""
    device = Handle()
    handle = OperatorHandle(device, RECOVERY_MM)
    device.place = places[0]
    handle.read(elapsed)
    for place in places[1:]:
        last = handle.command_mm
        device.place = place
        handle.losses += 1  # lost and found between two ticks
        handle.read(elapsed)
        assert math.dist(handle.command_mm, last) <= RECOVERY_MM * elapsed + 1e-9


def streamed(display):
    return StreamedForce(display, limit_n=5.0)


def passive(display):
    feedback = PassiveForce(display, limit_n=5.0, settings=PassivitySettings(), opening_j=1.0)
    record = np.zeros(1, dtype=ENERGY_DTYPE)
    record["energy_j"] = 1.0
    feedback.on_records(record)
    return feedback


def model(display):
    return ModelForce(display, limit_n=5.0, opening_j=1.0)


@pytest.mark.parametrize("make", [streamed, passive, model])
def test_the_force_is_gone_at_once_and_comes_back_from_zero(make):
    display = Handle()
    feedback = make(display)
    frame = np.zeros(1, dtype=frame_dtype())
    frame["force_n"] = (0.0, 0.0, 2.0)
    feedback.on_frames(frame)
    at = InterfaceState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, False)
    for _ in range(200):
        feedback.on_frames(frame)
        feedback.tick(1, at)
    assert display.shown == pytest.approx((0.0, 0.0, 2.0))
    feedback.pause(1)
    assert display.shown == (0.0, 0.0, 0.0)
    elsewhere = at._replace(position_mm=(0.0, 0.0, 80.0))
    course = []
    for _ in range(200):
        feedback.on_frames(frame)
        feedback.tick(1, elsewhere)
        course.append(display.shown[2])
    assert course[0] <= 0.04 + 1e-9  # a fiftieth of it
    assert np.abs(np.diff(course)).max() <= 0.08 + 1e-9  # a passive port begins a tick later
    assert course[-1] == pytest.approx(2.0)


def test_where_the_handle_comes_back_is_nobodys_work():
    display = Handle()
    feedback = passive(display)
    frame = np.zeros(1, dtype=frame_dtype())
    frame["force_n"] = (0.0, 0.0, 2.0)
    feedback.on_frames(frame)
    at = InterfaceState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, False)
    for _ in range(100):
        feedback.tick(1, at)
    before = feedback.summary["energy_in_mj"], feedback.summary["energy_out_mj"]
    feedback.pause(1)
    feedback.tick(1, at._replace(position_mm=(0.0, 0.0, -80.0)))
    feedback.tick(1, at._replace(position_mm=(0.0, 0.0, -80.0)))
    assert (feedback.summary["energy_in_mj"], feedback.summary["energy_out_mj"]) == before
