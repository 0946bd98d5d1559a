"""The leader's handle: an Inverse3 that the operator holds."""

from typing import Any

from mmt.core.arrays import Vector
from mmt.devices.drivers import read_options
from mmt.devices.leader_reports import InterfaceState
from mmt_devices.inverse3.driver import InverseDriver
from mmt_devices.inverse3.link import ServiceLink
from mmt_devices.inverse3.options import HandleOptions


class Inverse3Handle(InverseDriver):
    """Implements `LeaderInterface`; the options are those of `HandleOptions`.

    An Inverse3 measures no force. With ``hand_force = "contact"`` in ``[handle]``, the leader
    infers the force from the motion.

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
        self._of_handle = read_options(HandleOptions, "inverse3", options)
        super().__init__(self._of_handle)

    def _make_link(self) -> ServiceLink:
        options = self._of_handle
        servo = {
            "stale_ms": options.stale_ms,
            "ramp_ms": options.ramp_ms,
            "limit_n": options.force_limit_n,
        }
        return ServiceLink("handle", options, servo, self._counts)

    def read(self, elapsed_ticks: int) -> InterfaceState:  # noqa: ARG002 - the device has a clock
        """Return the handle's newest state.

        Raises
        ------
        DeviceLost
            The handle does not answer any more.
        """
        measured = self._measured(self._connected().read())
        position = self._axes.place_in_scene(measured.position_mm)
        velocity = self._axes.to_scene(measured.velocity_mm_s)
        return InterfaceState(position, velocity, 0.0, contact=False)

    def write(self, force_n: Vector) -> None:
        """Display a force (N), cut to the limit.

        A force that is not finite is counted and ignored.

        Raises
        ------
        DeviceLost
            The handle does not answer any more.
        """
        self._command(self._axes.to_device(force_n))
