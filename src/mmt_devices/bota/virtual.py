"""``virtual-bota``: another force sensor of the virtual lab."""

from typing import Any

from mmt.testing.emulated.drivers import VirtualSensor


class VirtualBota(VirtualSensor):
    """Another force sensor of the virtual lab; takes the options of ``bota-serial`` too."""

    def __init__(self, **options: Any) -> None:
        super().__init__("virtual-bota", "bota-serial", "bota", options, port="lab")
