"""The follower's arm: an Inverse3 that its service holds at commanded positions."""

from collections.abc import Sequence
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.devices.drivers import read_options
from mmt_devices.inverse3.driver import InverseDriver
from mmt_devices.inverse3.link import ServiceLink
from mmt_devices.inverse3.options import Inverse3RobotOptions

_LONGEST_TURN_S: Final = 0.02


class Inverse3Robot(InverseDriver):
    """Implements `Robot`; the options are those of `Inverse3RobotOptions`.

    Parameters
    ----------
    **options
        See `docs/how-to/inverse3.md`.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    def __init__(self, **options: Any) -> None:
        self._of_robot = read_options(Inverse3RobotOptions, "inverse3", options)
        super().__init__(self._of_robot)

    def _make_link(self) -> ServiceLink:
        options = self._of_robot
        servo = {
            "stale_ms": options.stale_ms,
            "speed_limit_mm_s": options.speed_limit_mm_s,
            "lead_limit_mm": options.lead_limit_mm,
        }
        return ServiceLink("robot", options, servo, self._counts)

    def await_turn(self) -> None:
        """Return soon after the service's next answer, or after 20 ms."""
        self._connected().await_answer(_LONGEST_TURN_S)

    def read(self) -> Vector:
        """Return the tip's newest position (mm).

        Raises
        ------
        DeviceLost
            The robot does not answer any more.
        """
        return self._axes.place_in_scene(self._measured(self._connected().read()).position_mm)

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return the newest positions (mm) that came between two times, the oldest first."""
        return [
            (measured.time_ns, self._axes.place_in_scene(measured.position_mm))
            for measured in tuple(self._connected().kept)
            if after_ns < measured.time_ns < until_ns
        ]

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm); count and ignore one that is not finite.

        Raises
        ------
        DeviceLost
            The robot does not answer any more.
        """
        self._command(self._axes.place_on_device(position_mm))
