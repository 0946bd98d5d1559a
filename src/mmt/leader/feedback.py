"""Kinesthetic feedback as in Awan et al., section IV: the streamed force goes to the hand."""

from mmt.arrays import RecordArray
from mmt.devices.protocols import LeaderInterface
from mmt.leader.silence import SILENCE_TICKS, SilenceRamp


class StreamedForce:
    """Write the newest streamed force to the leader's interface once a tick.

    Parameters
    ----------
    interface
        The operator's handle.
    limit_n
        Bound of the displayed force; its direction is kept.
    silence_ticks
        After so many ticks without a frame the force fades to zero over as many; when frames
        come again it returns over as many.
    """

    def __init__(
        self, interface: LeaderInterface, *, limit_n: float, silence_ticks: int = SILENCE_TICKS
    ) -> None:
        self._interface = interface
        self._limit_n = limit_n
        self._ramp = SilenceRamp(silence_ticks, silence_ticks)
        self._force = (0.0, 0.0, 0.0)

    def take(self, frames: RecordArray) -> None:
        """Keep the newest frame's force."""
        x, y, z = frames["force_n"][-1].tolist()
        magnitude = float((x * x + y * y + z * z) ** 0.5)
        scale = min(1.0, self._limit_n / magnitude) if magnitude > 0 else 1.0
        self._force = (x * scale, y * scale, z * scale)
        self._ramp.heard()

    def tick(self, elapsed: int) -> None:
        """Display the force for the elapsed ticks."""
        self._interface.write(self._ramp.shape(self._force, elapsed))
