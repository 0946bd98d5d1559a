"""Devices that take long to connect or to let go do not hold up the end."""

import os
import signal
import time
from pathlib import Path

import psutil
import pytest
from service_processes import LONGEST_S, Service, scene

from mmt.cli.common import stop_on_signals
from mmt.core.output.streams import finish_output
from mmt_devices.inverse3.emulated import EmulatedInverse3

SOON_S = 10.0
"""Loose bound of what takes less than two seconds on a quiet machine."""

DRIVERS = """
import time
from instruments import Instrument
from mmt.devices.protocols import InterfaceState

class Robot(Instrument):
    slow = ""

    def __init__(self, slow: str) -> None:
        super().__init__()
        self.slow = slow

    def _do(self, name: str) -> None:
        if name == self.slow:
            print(f"{name} begins", flush=True)
            time.sleep(600.0)

class Handle(Robot):
    def read(self, elapsed_ticks: int) -> InterfaceState:
        return InterfaceState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False)
"""


@pytest.fixture
def environment(tmp_path):
    (tmp_path / "slow_drivers.py").write_text(DRIVERS)
    paths = [str(tmp_path), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    return {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


def scene_with(directory, service, driver):
    """Write a scene whose handle or robot has this driver, and return its file's name."""
    tables = "[link]\n[playout]\n[actuator]\n"
    if service == "leader":
        tables += f"[handle]\n{driver}\n[simulated]\n"
    else:
        tables += f"[hand]\n[devices.robot]\n{driver}\n[devices.accelerometer]\n"
        tables += "driver = 'slow_drivers:Robot'\nslow = ''\n"
    file = directory / f"{service}.toml"
    file.write_text(tables)
    return str(file)


@pytest.fixture
def started(tmp_path, environment):
    """Starts a service with a driver, where need be beside a leader, and ends both."""
    running = []

    def start(name, driver):
        file = scene_with(tmp_path, name, driver)
        arguments = ("--json-lines",)
        if name == "follower":
            running.append(
                Service(*("leader", file, *arguments, "--port", 0), cwd=tmp_path, **environment)
            )
            arguments += ("--leader", f"http://127.0.0.1:{running[0].port()}")
        else:
            arguments += ("--port", "0")
        running.append(Service(name, file, *arguments, cwd=tmp_path, **environment))
        return running[-1]

    yield start
    for service in running:
        service.__exit__()


@pytest.mark.parametrize(("name", "slow"), [("leader", "calibrate"), ("follower", "connect")])
def test_a_device_that_never_connects_does_not_hold_up_the_end(name, slow, started):
    driver = f"driver = 'slow_drivers:{'Handle' if name == 'leader' else 'Robot'}'\nslow = '{slow}'"
    service = started(name, driver)
    service.wait_for(lambda: f"{slow} begins" in service.stdout)
    stopped_s = service.signal(signal.SIGINT)
    assert service.end() == 0, service.stderr
    assert time.monotonic() - stopped_s < SOON_S
    assert '"outcome": "stopped"' in service.stdout
    assert service.stderr == ""


@pytest.mark.parametrize("name", ["leader", "follower"])
def test_an_inverse3_that_waits_for_its_calibration_lets_go_at_once(name, started):
    emulated = EmulatedInverse3()
    emulated.start()
    try:
        emulated.fail("uncalibrated")
        address = emulated.options["address"]
        service = started(
            name, f"driver = 'inverse3'\naddress = '{address}'\ncalibration_s = 120.0"
        )
        service.wait_for(lambda: "is not calibrated" in service.stderr)
        children = psutil.Process(service.process.pid).children(recursive=True)
        assert children
        stopped_s = service.signal(signal.SIGTERM)
        assert service.end() == 0, service.stderr
        assert time.monotonic() - stopped_s < SOON_S
        _, left = psutil.wait_procs(children, timeout=SOON_S)
        assert not left
    finally:
        emulated.stop()
    assert service.summary()["outcome"] == "stopped"


@pytest.mark.parametrize("again", [signal.SIGINT, signal.SIGTERM])
def test_the_second_signal_ends_at_once_what_does_not_let_go(again, started):
    service = started("leader", "driver = 'slow_drivers:Handle'\nslow = 'close'")
    service.port()
    service.signal(signal.SIGINT)
    service.wait_for(lambda: "close begins" in service.stdout)
    assert service.process.poll() is None
    service.signal(again)
    assert service.end() == -again


def test_a_demo_that_is_interrupted_again_leaves_nothing(tmp_path):
    with Service("main", "demo", scene("stream-only"), "--verbose", cwd=tmp_path) as demo:
        demo.wait_for(lambda: "leader: follower connected" in demo.stderr)
        services = psutil.Process(demo.process.pid).children()
        for each in services:
            each.suspend()
        demo.signal(signal.SIGINT)
        time.sleep(0.5)
        demo.signal(signal.SIGINT)
        assert demo.end() == -signal.SIGINT
        for each in services:
            each.resume()
        _, left = psutil.wait_procs(services, timeout=LONGEST_S)
        assert not left


async def test_a_signal_wakes_the_loop_also_if_it_comes_just_before_the_loop_waits():
    stop_on_signals(lambda: None)
    finish_output()
    wakes = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(wakes)
    assert wakes != -1
