"""``virtual-iio``: another accelerometer of the virtual lab."""

from typing import Any

from mmt.testing.emulated.drivers import VirtualSensor


class VirtualIio(VirtualSensor):
    """Another accelerometer of the virtual lab; takes the options of ``iio-accelerometer`` too."""

    def __init__(self, **options: Any) -> None:
        super().__init__("virtual-iio", "iio-accelerometer", "iio", options)
