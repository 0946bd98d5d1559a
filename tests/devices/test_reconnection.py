"""A lost device is connected again, whatever its driver raises."""

from mmt.devices.reconnection import Reconnection


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
