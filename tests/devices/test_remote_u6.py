"""An emulated LabJack U6 in another process, met over sockets."""

import time
from itertools import pairwise

import pytest
from sensor_reading import read_some, read_until_lost

from mmt.core.errors import MmtError
from mmt.devices.drivers import load_device
from mmt.testing.emulated.labjack_u6 import EmulatedU6
from mmt.testing.emulated.remote_u6 import RemoteU6, U6Server


@pytest.fixture
def box():
    return EmulatedU6(lambda _time_ns: [1.65, 1.65, 1.98] + [0.0] * 11)


@pytest.fixture
def remote(box, started, closing):
    return closing(RemoteU6(started(U6Server(box)).address))


def accelerometer(remote):
    board = {"driver": "labjack-u6", "inputs": [0, 1, 2], "backend": remote}
    return load_device("adxl335-board", {"board": board, "bandwidth_hz": 1000})


def test_its_driver_reads_it_as_if_it_were_here(remote, connected):
    readings = read_some(connected(accelerometer(remote)), 100)
    assert readings[-1].value[2] == pytest.approx(9.8, abs=0.3)
    assert 0 < remote.own_ns < time.process_time_ns()
    steps = {b.time_ns - a.time_ns for a, b in pairwise(readings)}
    assert steps == {500_000}


def test_one_that_is_unplugged_is_lost(box, remote, connected):
    sensor = connected(accelerometer(remote))
    box.unplug()
    read_until_lost(sensor, "plug it in again")


def test_a_server_that_has_ended_is_a_device_that_is_gone(box):
    server = U6Server(box)
    server.start()
    remote = RemoteU6(server.address)
    remote.close()
    server.stop()
    with pytest.raises(MmtError, match="gone"):
        accelerometer(remote).connect()
