"""Rendering of a learned contact: locally with smooth parameters, and from the hand's motion.

The parameters approach the newest estimate exponentially. If the spring becomes stiffer, or the
surface moves towards the hand, the same depth stores more energy, which the hand has not put in.
The port that displays the force keeps this energy from the hand by an exact account of force and
travel (`mmt.contact.passivity.ForcePort`): the hand never receives more than it gave plus a small
reserve, however the parameters change. This restricts updates less than holding the stored energy
constant (Xu, Cizmeci, Schuwerk and Steinbach, "Model-mediated teleoperation: toward stable and
transparent teleoperation systems", IEEE Access 4 (2016), section V): then a hand at rest in contact
would not feel a model that comes late.

The force is held for a tick and therefore computed for the tick's middle. A spring evaluated at its
beginning would give back more than it took at each stroke, by half a tick's travel.

Cost: about 2 us a step in plain Python.

Two things are learned from the follower's samples. Position of the tool and force on it give the
place of the surface (`mmt.contact.estimation`): there the hand is in contact at once, whatever the
network. The depth of the command below the surface and the force give the stiffness of robot and
surface together. The robot follows its command with a lag T; to first order in T the force is

    F = k (x - T x') = k x + b x'

at a depth x of the command below the surface, with b = -k T. k and b are fitted by least squares in
moving contact; the hand is given k x, the force that its motion would have without the lag.

Cost: about 12 us a sample, and under 1 us a tick, in plain Python.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Final

from annotated_types import Ge, Gt

from mmt.contact.estimation import ContactEstimator, ContactModel, EstimationSettings
from mmt.contact.force_map import SmoothSpeed
from mmt.core.arrays import RecordArray
from mmt.core.bounds import check_fields
from mmt.core.sequence_numbers import SEQUENCES

_FILTER_S: Final = 3e-3
"""Time constant of the speed filter of the rendered damper: positions are quantised."""
_REFERENCE_N: Final = 1.0
"""Force at which a model's stiffness is compared with the largest allowed."""
_REFERENCE_M: Final = 1e-3
"""Depth at which the force of a model between two others lies between theirs."""


@dataclass(frozen=True, slots=True)
class RenderingSettings:
    """Limits and smoothing of the rendering.

    Parameters
    ----------
    stiffness_n_m
        Largest stiffness rendered, above 0. A sampled spring is passive by itself up to twice
        the damping of hand and handle over the tick (Colgate and Schenkel, "Passivity of a
        class of sampled-data systems", J. Robotic Systems 14 (1997)).
    damping_n_s_m
        Largest damping rendered, at least 0.
    smoothing_s
        Time constant of a change, at least 0.
    tick_s
        Length of a tick, above 0.

    Raises
    ------
    InputError
        A value is out of range or not finite.
    """

    stiffness_n_m: Annotated[float, Gt(0)] = 10_000.0
    damping_n_s_m: Annotated[float, Ge(0)] = 20.0
    smoothing_s: Annotated[float, Ge(0)] = 0.02
    tick_s: Annotated[float, Gt(0)] = 1e-3

    def __post_init__(self) -> None:
        check_fields(self)


class LocalContact:
    """Renderer of the contact model at the hand, called every tick."""

    def __init__(self, settings: RenderingSettings | None = None) -> None:
        self._settings = settings or RenderingSettings()
        self._target: ContactModel | None = None
        self._speed = SmoothSpeed(_FILTER_S)
        self.rendered: ContactModel | None = None
        """The model rendered now, None before the first."""

    def set_target(self, model: ContactModel | None) -> None:
        """Set the model that the rendered one approaches; None keeps the present target."""
        most = self._settings.stiffness_n_m
        if model is not None and model.stiffness_at(_REFERENCE_N) > most:
            model = replace(model, stiffness_n_m=most, exponent=1.0)
        self._target = model or self._target

    def reset_position(self) -> None:
        """Reset the position of the hand; the model is kept."""
        self._speed = SmoothSpeed(_FILTER_S)

    def step(self, depth_m: float, ticks: int = 1) -> float:
        """Return the force (N) against the axis into the surface, never negative.

        Parameters
        ----------
        depth_m
            The hand's place along that axis.
        ticks
            Ticks since the last step, at least 1.
        """
        if not math.isfinite(depth_m):
            return 0.0
        period_s = ticks * self._settings.tick_s
        speed_m_s = self._speed.step(depth_m, period_s)
        self._approach(period_s)
        if self.rendered is None:
            return 0.0
        middle_m = depth_m + 0.5 * period_s * speed_m_s
        return self.rendered.force_n(middle_m, speed_m_s, self._settings.damping_n_s_m)

    def _approach(self, period_s: float) -> None:
        """Go a share of the way to the target."""
        now, target = self.rendered, self._target
        if target is None or now is target:
            return
        smoothing_s = self._settings.smoothing_s
        if now is None or smoothing_s == 0.0:
            self.rendered = target
        else:
            self.rendered = _between(now, target, -math.expm1(-period_s / smoothing_s))


def _between(now: ContactModel, target: ContactModel, share: float) -> ContactModel:
    """Return the model at a share of the way from one to the other."""
    exponent = now.exponent + share * (target.exponent - now.exponent)
    logarithm = (1.0 - share) * _logarithm(now) + share * _logarithm(target)
    return ContactModel(
        surface_m=now.surface_m + share * (target.surface_m - now.surface_m),
        stiffness_n_m=math.exp(logarithm) * _REFERENCE_M**-exponent,
        exponent=exponent,
        damping_n_s_m=now.damping_n_s_m + share * (target.damping_n_s_m - now.damping_n_s_m),
        dissipation_s_m=now.dissipation_s_m
        + share * (target.dissipation_s_m - now.dissipation_s_m),
    )


def _logarithm(model: ContactModel) -> float:
    """Return the logarithm of a model's elastic force at the reference depth."""
    return math.log(model.stiffness_n_m) + model.exponent * math.log(_REFERENCE_M)


_RENEWAL: Final = 10
"""Number of samples between two queries of the estimate, which cost more than a sample."""
_LEAST_M2: Final = 1e-8
"""Least sum of squared depths in moving contact for a known stiffness: one depth of 0.1 mm."""
_REGULARISER: Final = 1e-12


class ContactSamples:
    """Reads the follower's samples along the normal, which is the axis of number `normal`."""

    def __init__(self, normal: int) -> None:
        self._normal = normal
        self._newest = -1

    def read(self, records: RecordArray) -> Iterator[tuple[float, float, float, int]]:
        """Yield command (m), place (m), force (N), and ticks since the last, of records (n,)."""
        axis = self._normal
        for command, place, force, number in zip(
            records["command_mm"][:, axis].tolist(),
            records["position_mm"][:, axis].tolist(),
            records["force_n"][:, axis].tolist(),
            records["sequence"].tolist(),
            strict=True,
        ):
            ticks = (number - self._newest) % SEQUENCES or SEQUENCES  # a long time if it restarted
            self._newest = number
            yield -1e-3 * command, -1e-3 * place, force, ticks


class HandContact:
    """Learn the contact from the follower's samples; return the force at the hand's position.

    Parameters
    ----------
    settings
        Settings of the surface's estimate; the forgetting time holds for the stiffness too.
    """

    def __init__(self, settings: EstimationSettings | None = None) -> None:
        settings = settings or EstimationSettings()
        self.surface: Final = ContactEstimator(settings)
        """Estimator of the surface from position of the tool and force on it."""
        self.surface_m: float | None = None
        """Position of the surface along the axis into it, or None before it was touched."""
        self._tick_s = settings.tick_s
        self._keep = math.exp(-settings.tick_s / settings.forgetting_s)
        self._speed = SmoothSpeed()
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)  # of x x, x x', x' x', x F, x' F
        self._samples = 0

    def update(self, command_m: float, place_m: float, force_n: float, ticks: int = 1) -> None:
        """Learn from one sample of the follower; one that is not finite is ignored.

        Parameters
        ----------
        command_m, place_m
            Commanded and measured position of the tool along the axis into the surface.
        force_n
            Force of the surface on the tool.
        ticks
            Ticks since the sample before, at least 1.
        """
        if not math.isfinite(command_m + place_m + force_n):
            return
        self.surface.update(place_m, force_n, ticks)
        speed_m_s = self._speed.step(command_m, ticks * self._tick_s)
        self._samples += 1
        if self._samples % _RENEWAL == 0:
            model = self.surface.best()
            self.surface_m = self.surface_m if model is None else model.surface_m
        if self.surface_m is not None and self.surface.contact and command_m > self.surface_m:
            self._fit(command_m - self.surface_m, speed_m_s, force_n)

    def _fit(self, x_m: float, v_m_s: float, force_n: float) -> None:
        new = x_m * x_m, x_m * v_m_s, v_m_s * v_m_s, x_m * force_n, v_m_s * force_n
        keep = self._keep
        a, b, c, d, e = (keep * old + now for old, now in zip(self._sums, new, strict=True))
        self._sums = (a, b, c, d, e)

    @property
    def stiffness_n_m(self) -> float | None:
        """Stiffness of robot and surface together, or None while it is not known."""
        xx, xv, vv, xf, vf = self._sums
        if xx < _LEAST_M2:
            return None
        determinant = xx * (vv + _REGULARISER) - xv * xv
        if determinant <= 0.0:
            return None
        stiffness = (xf * (vv + _REGULARISER) - xv * vf) / determinant
        return stiffness if stiffness > 0.0 else None

    def force_n(self, depth_m: float) -> float | None:
        """Return the force (N) at a position of the hand; 0 off the surface, None if not known."""
        surface_m, stiffness_n_m = self.surface_m, self.stiffness_n_m
        if surface_m is None or stiffness_n_m is None or not math.isfinite(depth_m):
            return None
        return stiffness_n_m * max(depth_m - surface_m, 0.0)
