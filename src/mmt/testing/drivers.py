"""The devices in software, registered as drivers: `mmt.devices.drivers` merges these tables.

Nothing is imported before a scene asks for it.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mmt.devices.drivers import Role

DRIVERS: Final[dict[str, Mapping["Role", str]]] = {
    "virtual-adxl335": {"accelerometer": "mmt.testing.emulated.drivers:VirtualAdxl335"},
    "virtual-bota": {"force_sensor": "mmt.testing.emulated.drivers:VirtualBota"},
    "virtual-handle-adxl335": {
        "accelerometer": "mmt.testing.emulated.drivers:VirtualHandleAdxl335"
    },
    "virtual-haptuator": {"actuator": "mmt.testing.emulated.drivers:VirtualHaptuator"},
    "virtual-haptuator-sound": {"actuator": "mmt.testing.emulated.haptuator:emulated_haptuator"},
    "virtual-iio": {"accelerometer": "mmt.testing.emulated.drivers:VirtualIio"},
    "virtual-inverse3": {
        "robot": "mmt.testing.emulated.virtual_inverse3:VirtualInverse3Robot",
        "handle": "mmt.testing.emulated.virtual_inverse3:VirtualInverse3Handle",
    },
    "virtual-net-ft": {"force_sensor": "mmt.testing.emulated.drivers:VirtualNetFt"},
    "virtual-ur": {
        "robot": "mmt.testing.emulated.universal_robots.drivers:VirtualUrRobot",
        "force_sensor": "mmt.testing.emulated.universal_robots.drivers:VirtualUrForceSensor",
    },
    "virtual-robot": {"robot": "mmt.testing.emulated.drivers:VirtualRobot"},
}
"""Name -> role -> ``module:factory``."""

LIBRARIES: Final = {"emulated": "mmt.testing.emulated.hd:build_library"}
"""Name -> ``module:function`` that returns the file of a vendor's library in software; the names
are what a driver's option ``library`` takes in the place of a file."""
