"""Model-mediated force: the remote contact is estimated, and rendered here without delay."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp
from typing import Any, Final, Literal

import numpy as np

from mmt.contact.estimation import ContactEstimator, ContactModel, EstimationSettings
from mmt.contact.force_map import ForceMap, SmoothSpeed
from mmt.contact.passivity import PassivitySettings
from mmt.contact.rendering import ContactSamples, HandContact, LocalContact, RenderingSettings
from mmt.core.arrays import RecordArray, Vector, bounded
from mmt.core.frames import CONTACT, CONTACT_DTYPE
from mmt.core.guards import SILENCE_TICKS, ForceDisplay
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.passivity_ports import PassivityPorts

_M: Final = 1e-3
_HANDOVER_S: Final = 0.02
"""Time constant of the change from the streamed force to the model's."""
_RENEWAL: Final = 10
"""Samples after which the rendered model is updated."""
_BEYOND: Final = 1.25
"""The model displays at most this times the largest force that was measured."""


@dataclass(frozen=True)
class ModelSettings:
    """Settings of the model method."""

    passivity: PassivitySettings = field(default_factory=PassivitySettings)
    estimation: EstimationSettings = field(default_factory=EstimationSettings)
    rendering: RenderingSettings = field(default_factory=RenderingSettings)
    normal: Literal["x", "y", "z"] = "z"


class ModelForce(StreamedForce):
    """Display the force of a contact model at the hand's own position.

    The follower sends its command, position and force (event `CONTACT`). Command and force give
    the model that the hand feels: the model of robot and surface together, so that the displayed
    force is the one that the follower will measure. Position and force give an estimate of the
    surface itself, for the summary. If the hand moves over positions that the tool has met at a
    similar speed, the force measured there is mixed with the model's (`mmt.contact.force_map`).
    Until there is a model, the streamed force is displayed; along the surface it always is. Both
    forces pass the passive port of `ForcePort`, so that no estimate can give the hand energy.
    About 20 us a tick, and 35 us a sample.

    Parameters
    ----------
    interface, limit_n, silence_ticks
        As `StreamedForce`.
    settings
        Settings of the method; None for the default.
    opening_j
        Energy that each account begins with.
    hand
        Estimates the surface from the same samples; None makes one.
    """

    event: str | None = CONTACT
    dtype: "np.dtype[np.void] | None" = CONTACT_DTYPE

    def __init__(
        self,
        interface: ForceDisplay,
        *,
        limit_n: float,
        settings: ModelSettings | None = None,
        silence_ticks: int = SILENCE_TICKS,
        opening_j: float = 0.0,
        hand: HandContact | None = None,
    ) -> None:
        super().__init__(interface, limit_n=limit_n, silence_ticks=silence_ticks)
        settings = settings or ModelSettings()
        self._ports = PassivityPorts(settings.passivity, limit_n=limit_n, opening_j=opening_j)
        self._felt = ContactEstimator(settings.estimation)
        self._hand = hand or HandContact(settings.estimation)
        self._contact = LocalContact(settings.rendering)
        self._memory = ForceMap()
        self._command_speed, self._hand_speed = SmoothSpeed(), SmoothSpeed()
        self._normal = "xyz".index(settings.normal)
        self._reader = ContactSamples(self._normal)
        self._tick_s = settings.passivity.tick_s
        self._share = 0.0
        self._samples = 0
        self._samples_to_model: int | None = None

    def on_records(self, records: RecordArray) -> None:
        """Learn from the follower's samples."""
        for command_m, place_m, force_n, ticks in self._reader.read(records):
            self._felt.update(command_m, force_n, ticks)
            speed_m_s = self._command_speed.step(command_m, ticks * self._tick_s)
            self._memory.add(command_m, speed_m_s, force_n)
            self._hand.update(command_m, place_m, force_n, ticks)
            self._samples += 1
            if self._samples % _RENEWAL == 0:
                self._contact.set_target(self._felt.best())

    def tick(self, elapsed: int, state: InterfaceState | None) -> RecordArray | None:
        """Display the force for the elapsed ticks; nothing is sent."""
        force = list(self._force)
        if state is not None:
            force[self._normal] = self._modelled_n(state, elapsed)
        x, y, z = bounded((force[0], force[1], force[2]), self._limit_n)
        wanted: Vector = self._ramp.shape((x, y, z), elapsed)
        self._show(self._ports.step(wanted, state, elapsed))
        return None

    def pause(self, elapsed: int) -> None:
        """Display no force; see `StreamedForce`. The models stay."""
        self._ports.pause()
        self._contact.reset_position()
        self._hand_speed = SmoothSpeed()
        super().pause(elapsed)

    def _modelled_n(self, state: InterfaceState, elapsed: int) -> float:
        """Return the force along the normal (N), mixed from stream, model and force map."""
        axis = self._normal
        depth_m = -_M * (state.position_mm[axis] + self.offset_mm[axis])
        period_s = elapsed * self._tick_s
        modelled = min(
            self._contact.step(depth_m, elapsed), _BEYOND * self._felt.largest_n, self._limit_n
        )
        if self._contact.rendered is not None:
            if self._samples_to_model is None:
                self._samples_to_model = self._samples
            keep = exp(-period_s / _HANDOVER_S)
            self._share = 1.0 - keep * (1.0 - self._share)
        force_n = self._force[self._normal]
        force_n += self._share * (modelled - force_n)
        speed_m_s = self._hand_speed.step(depth_m, period_s)
        remembered_n, weight = self._memory.look_up(depth_m, speed_m_s)
        return force_n + weight * (remembered_n - force_n)

    @property
    def contact_model(self) -> ContactModel | None:
        """The model that the hand feels, or None before there is one."""
        return self._contact.rendered

    @property
    def surface(self) -> ContactModel | None:
        """The estimate of the surface itself."""
        return self._hand.surface.best()

    @property
    def summary(self) -> Mapping[str, Any]:
        """Estimates and energies."""
        surface = self._hand.surface
        return {
            **super().summary,
            "method": "model",
            **self._ports.summary,
            "contacts": surface.contacts,
            "contact_samples": surface.samples,
            "model_after_s": None
            if self._samples_to_model is None
            else round(self._samples_to_model * self._tick_s, 3),
            "surface": _table(surface.kelvin_voigt()),
            "surface_hunt_crossley": _table(surface.hunt_crossley()),
            "felt": _table(self.contact_model),
        }


def _table(model: ContactModel | None) -> dict[str, float]:
    """Return a model in the units of a scene, empty if there is none."""
    if model is None:
        return {}
    table = {
        "surface_mm": round(-1e3 * model.surface_m, 3),
        "stiffness_n_mm": float(f"{model.stiffness_n_m * _M**model.exponent:.4g}"),
    }
    if model.exponent != 1.0:
        table["exponent"] = round(model.exponent, 3)
    if model.dissipation_s_m:
        table["dissipation_s_m"] = float(f"{model.dissipation_s_m:.4g}")
    elif model.exponent == 1.0:
        table["damping_n_s_m"] = float(f"{model.damping_n_s_m:.4g}")
    return table
