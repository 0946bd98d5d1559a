"""A lost device is connected again, whatever its driver raises."""

import time

import pytest

from mmt.core.errors import DeviceLost
from mmt.devices.reconnection import ReconnectingActuator, ReconnectingHandle, Reconnection
from mmt.devices.streaming.source import DeviceSource


class Stuck:
    """Cannot be closed once it is lost; connects at the second try."""

    def __init__(self):
        self.tries = 0

    def close(self):
        raise OSError("the handle is gone")

    def connect(self):
        self.tries += 1
        if self.tries < 2:
            raise ConnectionError("not yet")


def test_a_device_that_cannot_be_closed_is_connected_all_the_same():
    device = Stuck()
    reconnection = Reconnection(device)
    assert reconnection.done.wait(20.0)
    assert (device.tries, reconnection.reason) == (2, "not yet")


class Mute:
    """Can always be connected, and answers so many times after that."""

    def __init__(self, answers=0):
        self._answers = answers
        self.connected_s = []

    def connect(self):
        self.connected_s.append(time.monotonic())
        self._left = self._answers

    def calibrate(self):
        """Need none."""

    close = calibrate

    def read(self, elapsed_ticks=1):
        self._left -= 1
        if self._left < 0:
            raise DeviceLost("it does not answer")
        return (0.0, 0.0, 0.0)

    def write(self, samples_m_s2):
        self.read()


def of_follower(device, told):
    source = DeviceSource(device, None, None, ("position",), on_lost="hold")
    source.on_loss(lambda _, sentence: told.append(sentence))
    source.start(0)
    return source, lambda: source.step(1, time.monotonic_ns(), None)


def of_leader(wrapped, told):
    wrapped.watch(lambda sentence, **_: told.append(sentence))
    wrapped.connect()
    return wrapped


def handle(device, told):
    wrapped = of_leader(ReconnectingHandle(device), told)
    return wrapped, lambda: wrapped.read(1)


def actuator(device, told):
    wrapped = of_leader(ReconnectingActuator(device), told)
    return wrapped, lambda: wrapped.write([0.0])


@pytest.mark.parametrize(
    ("kind", "answers"),
    [(of_follower, 0), (of_follower, 1), (of_follower, 3), (handle, 0), (actuator, 0)],
)
def test_a_device_that_connects_and_does_not_answer_is_not_connected_all_the_time(kind, answers):
    device, told = Mute(answers), []
    owner, look = kind(device, told)
    while len(device.connected_s) < 3:
        look()
        time.sleep(0.001)
    owner.close()
    _, first_s, second_s = device.connected_s  # the first try comes at once
    assert second_s - first_s > 0.4
    assert len(told) < 10
