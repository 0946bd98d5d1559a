"""A device for tests of what reads devices."""

from mmt.core.arrays import Vector


class Instrument:
    """A device that notes its life and fails where it is told to."""

    def __init__(self, value: float = 0.0, **failures: Exception) -> None:
        self.value = value
        self.failures = failures
        self.calls: list[str] = []
        self.written: list[Vector] = []

    def _do(self, name: str) -> None:
        self.calls.append(name)
        if name in self.failures:
            raise self.failures[name]

    def connect(self) -> None:
        self._do("connect")

    def calibrate(self) -> None:
        self._do("calibrate")

    def close(self) -> None:
        self._do("close")

    def read(self) -> Vector:
        self._do("read")
        return (self.value, self.value + 1, self.value + 2)

    def write(self, position_mm: Vector) -> None:
        self._do("write")
        self.written.append(position_mm)
