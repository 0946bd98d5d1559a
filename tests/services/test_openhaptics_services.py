"""A handle moves a robot through both services, on the emulated library."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from service_runs import run_session

from mmt.devices.emulated.hd import EmulatedHd
from mmt.errors import MmtError
from mmt.scene_files import scene_from_tables
from mmt.session import read_session


@pytest.fixture
def emulated() -> Iterator[EmulatedHd]:
    def stroke(time_ns: int) -> tuple[float, float, float]:
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


async def test_the_operators_handle_moves_the_followers_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, emulated: EmulatedHd
) -> None:
    (tmp_path / "still_sensor.py").write_text(STILL)
    monkeypatch.syspath_prepend(str(tmp_path))
    arm = {"driver": "openhaptics", "library": emulated.address}
    scene = scene_from_tables(
        {
            "session": {"duration_s": 1.5},
            "link": {"port": 0},
            "handle": {**arm, "device": "Left"},
            "devices": {
                "robot": {**arm, "device": "Right"},
                "force_sensor": "still_sensor:Still",
                "accelerometer": "still_sensor:Still",
            },
            "force_feedback": {},
            "recording": {"file": str(tmp_path / "session.mcap")},
        }
    )
    leader, follower = await run_session(scene, None)
    assert (leader.outcome, follower.problem) == ("completed", None)
    x = read_session(tmp_path / "session.mcap").frames["position_mm"][:, 0]
    assert x.max() - x.min() > 15.0
