"""Make the force feedback that a scene chooses; the others are not even imported."""

from typing import TYPE_CHECKING, Literal

from mmt.leader.feedback import Feedback, ForceDisplay, StreamedForce
from mmt.scene import ForceFeedback

if TYPE_CHECKING:
    from mmt.contact.passivity import PassivitySettings


def build_feedback(
    table: ForceFeedback,
    interface: ForceDisplay,
    *,
    rate_hz: float,
    normal: Literal["x", "y", "z"],
) -> Feedback:
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
    """
    if table.method == "passive":
        from mmt.leader.feedback_passive import PassiveForce

        return PassiveForce(
            interface, limit_n=table.limit_n, settings=_passivity(table, 1.0 / rate_hz)
        )
    if table.method == "model":
        return _model(table, interface, 1.0 / rate_hz, normal)
    return StreamedForce(interface, limit_n=table.limit_n)


def _model(
    table: ForceFeedback,
    interface: ForceDisplay,
    tick_s: float,
    normal: Literal["x", "y", "z"],
) -> Feedback:
    from mmt.contact.estimation import EstimationSettings
    from mmt.contact.rendering import RenderingSettings
    from mmt.leader.feedback_model import ModelForce, ModelSettings

    settings = ModelSettings(
        passivity=_passivity(table, tick_s),
        estimation=EstimationSettings(table.contact_n, table.forgetting_s, tick_s),
        rendering=RenderingSettings(1e3 * table.largest_stiffness_n_mm, tick_s=tick_s),
        normal=normal,
    )
    return ModelForce(interface, limit_n=table.limit_n, settings=settings)


def _passivity(table: ForceFeedback, tick_s: float) -> "PassivitySettings":
    from mmt.contact.passivity import PassivitySettings

    return PassivitySettings(
        reserve_j=1e-3 * table.reserve_mj,
        damping_n_s_m=table.largest_damping_n_s_m,
        tick_s=tick_s,
    )
