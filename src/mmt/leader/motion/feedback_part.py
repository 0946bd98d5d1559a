"""The part that displays the remote force; only the module of the scene's method is imported."""

from typing import TYPE_CHECKING, Any, Literal, Protocol

from mmt.core.arrays import RecordArray
from mmt.core.guards import FADE_TICKS, SILENCE_TICKS, ForceDisplay, GuardedDisplay
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.part import Part, Session, Tick
from mmt.scene import ForceFeedback

if TYPE_CHECKING:
    from mmt.contact.passivity import PassivitySettings
    from mmt.contact.rendering import HandContact
    from mmt.leader.motion.feedback_model import ModelSettings


class OtherForce(Protocol):
    """Makes the feedback of a force that does not come from the follower."""

    def __call__(
        self, interface: ForceDisplay, *, limit_n: float, settings: "ModelSettings"
    ) -> StreamedForce:
        """Return the feedback, which displays at most `limit_n`."""


class ForceFeedbackPart(Part):
    """Display force once a tick: none while the handle is lost; the force fades without a stream.

    Parameters
    ----------
    session
        Session of the run.
    feedback
        The method's side at the leader.
    bound
        Bounds the forces that the method writes.
    """

    def __init__(self, session: Session, feedback: StreamedForce, bound: GuardedDisplay) -> None:
        self._session = session
        self.feedback = feedback
        self._bound = bound
        self._given_ticks = 0

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Use the newest frame's force, but not while control is away: then the force fades."""
        if not self._given_ticks:
            self.feedback.on_frames(frames)

    def tick(self, tick: Tick) -> None:
        """Display the force, and send the method's records to the follower."""
        self._given_ticks = self._given_ticks + tick.elapsed if tick.overridden else 0
        self.feedback.offset_mm = tick.offset_mm
        if tick.hand_lost or self._given_ticks > FADE_TICKS:
            self.feedback.pause(tick.elapsed)
            return
        news = self.feedback.tick(tick.elapsed, tick.state)
        if news is not None and self._session.remote is not None:
            self._session.remote.server.send_extra(news)

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return the counts and estimates of the method."""
        bound = self._bound
        counts = {"slew_limited": bound.limited_writes, "not_finite": bound.guard.not_finite}
        return {"feedback": {**self.feedback.summary, **counts}}


def build_feedback(
    table: ForceFeedback,
    interface: ForceDisplay,
    *,
    rate_hz: float,
    normal: Literal["x", "y", "z"],
    silence_ticks: int = SILENCE_TICKS,
    opening_j: float = 0.0,
    contact: "HandContact | None" = None,
) -> StreamedForce:
    """Return the leader's side of the scene's method.

    Parameters
    ----------
    table
        The scene's ``[force_feedback]``.
    interface
        The operator's handle.
    rate_hz
        Ticks a second.
    normal
        The surface's normal axis.
    silence_ticks
        As of `StreamedForce`.
    opening_j
        Energy that each account begins with, in a method that counts it.
    contact
        Estimates the surface, in a method that models it; None makes one.
    """
    if table.method == "streamed":
        return StreamedForce(interface, limit_n=table.limit_n, silence_ticks=silence_ticks)
    if table.method == "passive":
        from mmt.leader.motion.feedback_passive import PassiveForce

        return PassiveForce(
            interface,
            limit_n=table.limit_n,
            settings=_passivity(table, 1.0 / rate_hz),
            silence_ticks=silence_ticks,
            opening_j=opening_j,
        )
    from mmt.leader.motion.feedback_model import ModelForce

    return ModelForce(
        interface,
        limit_n=table.limit_n,
        settings=model_settings(table, 1.0 / rate_hz, normal),
        silence_ticks=silence_ticks,
        opening_j=opening_j,
        hand=contact,
    )


def model_settings(
    table: ForceFeedback, tick_s: float, normal: Literal["x", "y", "z"]
) -> "ModelSettings":
    """Return the settings of a method that models the contact."""
    from mmt.contact.estimation import EstimationSettings
    from mmt.contact.rendering import RenderingSettings
    from mmt.leader.motion.feedback_model import ModelSettings

    return ModelSettings(
        passivity=_passivity(table, tick_s),
        estimation=EstimationSettings(table.contact_n, table.forgetting_s, tick_s),
        rendering=RenderingSettings(1e3 * table.largest_stiffness_n_mm, tick_s=tick_s),
        normal=normal,
    )


def _passivity(table: ForceFeedback, tick_s: float) -> "PassivitySettings":
    from mmt.contact.passivity import PassivitySettings

    return PassivitySettings(
        reserve_j=1e-3 * table.reserve_mj,
        damping_n_s_m=table.largest_damping_n_s_m,
        tick_s=tick_s,
    )
