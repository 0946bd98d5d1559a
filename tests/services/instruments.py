"""A device for tests of what reads devices."""


class Instrument:
    """A device that notes its life and fails where it is told to."""

    def __init__(self, value=0.0, **failures):
        self.value = value
        self.failures = failures
        self.calls = []
        self.written = []

    def _do(self, name):
        self.calls.append(name)
        if name in self.failures:
            raise self.failures[name]

    def connect(self):
        self._do("connect")

    def calibrate(self):
        self._do("calibrate")

    def close(self):
        self._do("close")

    def read(self):
        self._do("read")
        return (self.value, self.value + 1, self.value + 2)

    def write(self, position_mm):
        self._do("write")
        self.written.append(position_mm)
