"""Contact and force of a hand whose handle measures no force, without the network's delay."""

from typing import Any, Final

import numpy as np

from mmt.contact.estimation import ContactModel, EstimationSettings
from mmt.contact.rendering import ContactSamples, HandContact
from mmt.core.arrays import RecordArray, Vector
from mmt.core.frames import CONTACT, CONTACT_DTYPE
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.part import Session

_M: Final = 1e-3
_LEAST_N: Final = 0.05
"""The follower's force, which has noise, counts as contact above this."""


class FollowerContact:
    """Contact of the hand, estimated from the contact samples of the follower.

    Until the first touch has shown the place and the stiffness of the surface, the hand's force is
    the follower's, with its delay. Without a follower the surface is at the scene's zero, or at
    the place that another leader reports.

    Parameters
    ----------
    session
        Session of the run.
    stiffness_n_mm
        Stiffness of the surface at the scene's zero, which nobody measures.
    """

    event: str | None = CONTACT
    dtype: "np.dtype[np.void] | None" = CONTACT_DTYPE

    def __init__(self, session: Session, stiffness_n_mm: float) -> None:
        scene = session.scene
        self._session = session
        self._normal = "xyz".index(scene.normal)
        self._reader = ContactSamples(self._normal)
        feedback = scene.force_feedback
        given = {} if feedback is None else {"contact_n": feedback.contact_n}
        self.model: Final = HandContact(
            EstimationSettings(**given, tick_s=1.0 / scene.session.rate_hz)
        )
        """Estimate of the surface's place and stiffness."""
        self._has_follower = scene.link is not None
        self._assumed = ContactModel(0.0, 1e3 * stiffness_n_mm)
        self._streamed_n = 0.0
        self._told = False

    def on_records(self, records: RecordArray) -> None:
        """Learn from the follower's samples (n,) of `CONTACT_DTYPE`."""
        for sample in self._reader.read(records):
            self.model.update(*sample)

    def restart(self) -> None:
        """Do nothing: the samples' numbers show a follower that was restarted."""

    def on_frames(self, frames: RecordArray) -> None:
        """Note the newest force of frames (n,), which is used until the contact is known."""
        if frames.dtype.names and "force_n" in frames.dtype.names:
            self._streamed_n = float(frames["force_n"][-1, self._normal])

    def state_of(
        self, state: InterfaceState, place_mm: Vector, shared: ContactModel | None = None
    ) -> InterfaceState:
        """Return a handle's state with contact and force.

        Parameters
        ----------
        state
            State from the handle.
        place_mm
            Position of the hand in the robot's space (mm).
        shared
            The contact of another leader's robot, if this hand moves it.
        """
        depth_m = -_M * place_mm[self._normal]
        if not self._has_follower:
            force_n = (shared or self._assumed).spring_n(depth_m)
            return state._replace(force_n=force_n, contact=force_n > 0.0)
        known_n = self.model.force_n(depth_m)
        if known_n is None:
            late_n = max(self._streamed_n, 0.0)
            return state._replace(force_n=late_n, contact=late_n > _LEAST_N)
        if not self._told:
            self._told, table = True, self.summary
            self._session.journal.event(
                "the hand's contact is known without delay from now on: the surface is at "
                f"{table['surface_mm']:g} mm, the robot on it gives "
                f"{table['stiffness_n_mm']:g} N/mm",
                **table,
            )
        return state._replace(force_n=known_n, contact=known_n > 0.0)

    @property
    def summary(self) -> dict[str, Any]:
        """Place and stiffness of the surface, empty while they are not known."""
        surface_m, stiffness_n_m = self.model.surface_m, self.model.stiffness_n_m
        if surface_m is None or stiffness_n_m is None:
            return {}
        return {
            "surface_mm": round(-1e3 * surface_m, 3),
            "stiffness_n_mm": float(f"{1e-3 * stiffness_n_m:.4g}"),
        }
