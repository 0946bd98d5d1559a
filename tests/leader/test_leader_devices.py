"""A real handle and a real actuator in the leader: made by their drivers, named when they fail."""

import pytest
from instruments import Instrument

from mmt.core.errors import InputError, MmtError
from mmt.devices.protocols import InterfaceState
from mmt.leader.part import Session
from mmt.leader.parts import build_parts
from mmt.scene.files import load_scene, scene_from_tables


class Device(Instrument):
    """A device that keeps its options; it cannot be connected if one says that it is absent."""

    def __init__(self, **options):
        super().__init__(**{"connect": OSError("no such port")} if "absent" in options else {})
        self.options = options


class Handle(Device):
    def read(self, elapsed_ticks):
        return InterfaceState((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0, False)


class FastActuator(Device):
    def set_rate(self, rate_hz):
        self.calls.append(rate_hz)


def scene(**handle):
    return scene_from_tables(
        {
            "link": {},
            "devices": {"robot": "lab:Robot", "accelerometer": "lab:A"},
            "handle": {"driver": f"{__name__}:Handle", **handle},
            "playout": {},
            "actuator": {"driver": f"{__name__}:Device", "volts": 2.0, "limit_m_s2": 30.0},
        }
    )


def test_handle_and_actuator_are_made_by_their_drivers_with_their_options():
    parts = build_parts(Session(scene(arm="left")))
    hand, vibration = parts.hand, parts.vibration
    assert hand.handle is hand.device is not None
    assert hand.handle.device.options == {"arm": "left"}
    assert vibration.reconnecting.device.options == {"volts": 2.0}
    parts.connect()
    assert parts.close() == []
    for device in (hand.handle.device, vibration.reconnecting.device):
        assert device.calls == ["connect", "calibrate", "close"]


@pytest.mark.parametrize("rate_hz", [1000, 5000])
def test_an_actuator_learns_the_rate_before_it_is_connected(rate_hz):
    tables = scene().dump()
    tables["session"]["acceleration_rate_hz"] = rate_hz
    tables["actuator"]["driver"] = f"{__name__}:FastActuator"
    parts = build_parts(Session(scene_from_tables(tables)))
    parts.connect()
    assert parts.close() == []
    calls = parts.vibration.reconnecting.device.calls
    assert calls == [float(rate_hz), "connect", "calibrate", "close"]
    tables["actuator"]["driver"] = f"{__name__}:Device"  # of 1 kHz alone
    if rate_hz > 1000:
        with pytest.raises(InputError, match=r"plays 1000 samples a second.*_hz is 5000"):
            build_parts(Session(scene_from_tables(tables)))


def test_a_handle_that_does_not_answer_is_named():
    parts = build_parts(Session(scene(absent=True)))
    with pytest.raises(MmtError, match="Handle cannot be connected: no such port"):
        parts.connect()


def test_a_replay_leaves_the_handle_out(tmp_path):
    file = tmp_path / "handle.toml"
    file.write_text(
        '[link]\n[devices]\nrobot = "a:B"\n[handle]\ndriver = "a:C"\n'
        "[recording]\n[force_feedback]\n"
    )
    replayed = load_scene(file, replay=tmp_path / "session.npz")
    assert (replayed.handle, replayed.devices, replayed.force_feedback) == (None, None, None)
