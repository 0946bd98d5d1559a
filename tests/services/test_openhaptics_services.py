"""A handle moves a robot through both services, on the emulated library."""

import asyncio
import math

import pytest
from service_runs import Together, run_session

from mmt.core.errors import MmtError
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session
from mmt.testing.emulated.openhaptics.hd import EmulatedHd


@pytest.fixture
def emulated():
    def stroke(time_ns):
        return (20.0 * math.sin(6e-9 * time_ns), 10.0, 0.0)

    try:
        device = EmulatedHd(stroke, hand_n_mm=1.0)
    except MmtError as error:
        pytest.skip(str(error))
    device.start()
    yield device
    device.stop()


STILL = """
class Still:
    def connect(self): pass
    def calibrate(self): pass
    def close(self): pass
    def read(self): return (0.0, 0.0, 0.0)
"""


def scene_of(emulated, file, duration_s, **devices):
    arm = {"driver": "openhaptics", "library": emulated.address}
    return scene_from_tables(
        {
            "session": {"duration_s": duration_s},
            "link": {"port": 0},
            "handle": {**arm, "device": "Left"},
            "devices": {
                "robot": {**arm, "device": "Right"},
                "force_sensor": "still_sensor:Still",
                "accelerometer": "still_sensor:Still",
                **devices,
            },
            "force_feedback": {},
            "recording": {"file": str(file)},
        }
    )


async def test_the_operators_handle_moves_the_followers_arm(tmp_path, monkeypatch, emulated):
    (tmp_path / "still_sensor.py").write_text(STILL)
    monkeypatch.syspath_prepend(str(tmp_path))
    scene = scene_of(emulated, tmp_path / "session.mcap", 1.5)
    leader, follower = await run_session(scene, None)
    assert (leader.outcome, follower.problem) == ("completed", None)
    x = read_session(tmp_path / "session.mcap").frames["position_mm"][:, 0]
    assert x.max() - x.min() > 15.0


async def test_arms_that_are_unplugged_while_they_run_come_back_and_the_recording_is_kept(
    tmp_path, monkeypatch, emulated
):
    (tmp_path / "still_sensor.py").write_text(STILL)
    monkeypatch.syspath_prepend(str(tmp_path))
    file = tmp_path / "session.mcap"
    together = await Together.listening(scene_of(emulated, file, 4.0, on_lost="hold"))
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.time_s > 0.5)
    emulated.unplug()
    await asyncio.sleep(0.5)
    motors = emulated.tip_state(device=0).motor_n, emulated.tip_state(device=1).motor_n
    emulated.plug()
    leader, follower = await together.end(), await following
    assert motors == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert (leader.outcome, follower.problem) == ("completed", None)
    assert follower.devices["robot"]["losses"] >= 1
    frames = read_session(file).frames
    gaps = frames["sequence"][1:] - frames["sequence"][:-1]
    assert gaps.max() > 100  # while it was lost, nothing was invented
    after = frames["sequence"] > frames["sequence"][gaps.argmax() + 1]
    assert after.any()
