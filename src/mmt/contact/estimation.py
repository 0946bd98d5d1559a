"""Estimation of contact models from the depth of a tool and the force on it.

Two models side by side, each linear in three parameters that recursive least squares fits
(`mmt.contact.least_squares`):

- Kelvin-Voigt: ``F = k (x - s) + b x'``, with k, b and k s as parameters, so that the surface
  s need not be known.
- Hunt-Crossley: ``F = K d^n (1 + a d')`` at depth d below the place of touch, linear in its
  logarithm, ``log F = log K + n log d + a d'`` as long as ``|a d'|`` is small (Haddadi and
  Hashtrudi-Zaad, "Real-time identification of Hunt-Crossley dynamic models of contact
  environments", IEEE Trans. Robot. 28 (2012)). The place of touch is the last one without a
  force; as it is seen late, deep samples count more.

Force and depth pass the same first-order filter, whose own state gives the derivative: a linear
relation before the filter holds after it with the same parameters (a state variable filter).
Samples are used in contact, and when a model expects a force but there is none; both only while
the tool moves or the model is wrong. At all other times nothing is updated or forgotten. The model
in use is the one that has predicted the force better.

A surface does not pull: pulls come from bias, drag and inertia, and pushes no larger than these are
not attributed to a surface either. Contact cannot begin while the tool moves outward: such samples
are ignored.

Cost: about 9 us a sample in plain Python, 2 us before the first contact, and 17 us for `best`.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Final

from annotated_types import Gt

from mmt.contact.least_squares import RecursiveLeastSquares
from mmt.core.bounds import check_fields

_MM: Final = 1e3
_SPEED_SCALE: Final = 0.1
"""m/s that count as one in the regression: parameters are then of like size."""
_FILTER_S: Final = 3e-3
_STILL_M_S: Final = 1e-3
_WRONG_N: Final = 0.1
_SHALLOWEST_M: Final = 2e-5
_SURE: Final = 3.0
"""A parameter counts once it exceeds its standard error by this factor."""
_LEAST_EXPLAINED: Final = 0.05
_ERROR_MEMORY_S: Final = 1.0
_LEAST_STIFFNESS_N_M: Final = 1.0
_LARGEST_STIFFNESS_N_M: Final = 1e6
_LARGEST_DAMPING_N_S_M: Final = 1e4
_LARGEST_DISSIPATION_S_M: Final = 10.0
_EXPONENTS: Final = (0.5, 3.0)
_NOISE_N: Final = 0.05
_FREE: Final = 0.25
"""Share of the contact's threshold below which the tool is taken to be free."""
_PULL_MEMORY_S: Final = 5.0
_PULL_MARGIN: Final = 1.25
_PULL_SHARE: Final = 0.25
"""No pull moves the threshold above this share of the largest force."""


@dataclass(frozen=True, slots=True)
class ContactModel:
    """A surface that pushes back with ``K d^n + (c + a K d^n) d'`` at depth d, never pulling.

    Parameters
    ----------
    surface_m
        Position of the surface, from which depth is counted.
    stiffness_n_m
        K, in N/m^n; with ``exponent`` 1 the stiffness of a spring.
    exponent
        n.
    damping_n_s_m
        Kelvin-Voigt damping c.
    dissipation_s_m
        Hunt-Crossley dissipation a.
    """

    surface_m: float
    stiffness_n_m: float
    exponent: float = 1.0
    damping_n_s_m: float = 0.0
    dissipation_s_m: float = 0.0

    def spring_n(self, depth_m: float) -> float:
        """Return the elastic force (N) at a place `depth_m` along the axis into the surface."""
        depth = depth_m - self.surface_m
        return float(self.stiffness_n_m * depth**self.exponent) if depth > 0.0 else 0.0

    def force_n(
        self, depth_m: float, speed_m_s: float, largest_damping_n_s_m: float = math.inf
    ) -> float:
        """Return the force (N) at a place and a speed into the surface."""
        spring = self.spring_n(depth_m)
        if spring <= 0.0:
            return 0.0
        damping = self.damping_n_s_m + self.dissipation_s_m * spring
        return max(0.0, spring + min(damping, largest_damping_n_s_m) * speed_m_s)

    def stiffness_at(self, force_n: float) -> float:
        """Return the slope of the elastic force (N/m) at the depth of a force `force_n`."""
        if self.exponent == 1.0 or force_n <= 0.0:
            return self.stiffness_n_m
        depth = float((force_n / self.stiffness_n_m) ** (1.0 / self.exponent))
        return self.exponent * force_n / depth


@dataclass(frozen=True, slots=True)
class EstimationSettings:
    """Contact threshold and memory of the estimator.

    Parameters
    ----------
    contact_n
        Contact begins above this force and recent pulls, and ends below half of it; above 0.
    forgetting_s
        Time in moving contact after which a sample weighs 1/e; above 0.
    tick_s
        Time between samples.

    Raises
    ------
    InputError
        A value is not above 0.
    """

    contact_n: Annotated[float, Gt(0)] = 0.2
    forgetting_s: Annotated[float, Gt(0)] = 0.5
    tick_s: Annotated[float, Gt(0)] = 1e-3

    def __post_init__(self) -> None:
        check_fields(self)


class ContactEstimator:
    """Estimate the contact from samples of depth and force, in the order of their ticks."""

    def __init__(self, settings: EstimationSettings | None = None) -> None:
        self._settings = settings or EstimationSettings()
        tick_s = self._settings.tick_s
        forgetting = math.exp(-tick_s / self._settings.forgetting_s)
        self._error_keep = math.exp(-tick_s / _ERROR_MEMORY_S)
        self._linear = RecursiveLeastSquares(
            (2500.0, 100.0, 400.0), noise_variance=_NOISE_N**2, forgetting=forgetting
        )
        self._power = RecursiveLeastSquares(
            (4.0, 0.25, 1.0),
            noise_variance=_NOISE_N**2,
            forgetting=forgetting,
            start=(0.0, 1.0, 0.0),
        )
        # not known before the first sample, or the first contact
        self._depth_m = self._force_n = self._free_m = math.nan
        self._origin_m = self._onset_m = math.nan
        self._square = self._linear_error = self._power_error = 0.0
        self._pull_keep = math.exp(-tick_s / _PULL_MEMORY_S)
        self._pull_n = 0.0
        self._stray = False
        self.contact = False
        """Whether the tool touches now."""
        self.contacts = 0
        """Contacts begun so far."""
        self.samples = 0
        """Number of samples that were used."""
        self.largest_n = 0.0
        """Largest force so far, filtered."""

    def update(self, depth_m: float, force_n: float, ticks: int = 1) -> None:
        """Update the models with a sample; one that is not finite is ignored.

        Parameters
        ----------
        depth_m
            Place along the axis into the surface, from any origin.
        force_n
            Force of the surface on the tool, against that axis.
        ticks
            Ticks since the sample before, at least 1.
        """
        if not math.isfinite(depth_m + force_n):
            return
        if math.isnan(self._depth_m):
            self._depth_m, self._force_n, self._free_m = depth_m, force_n, depth_m
        if ticks > 1 and self.contacts:
            self._free_m = self._onset_m  # a touch in the gap was not at the last free place
        period_s = ticks * self._settings.tick_s
        share = -math.expm1(-period_s / _FILTER_S)
        self._force_n += share * (force_n - self._force_n)
        moved_m = share * (depth_m - self._depth_m)
        self._depth_m += moved_m
        speed_m_s = moved_m / period_s
        self.largest_n = max(self.largest_n, self._force_n)
        self._detect(speed_m_s)
        if self.contacts and not self._stray:
            self._learn(speed_m_s / _SPEED_SCALE)

    def kelvin_voigt(self) -> ContactModel | None:
        """Return the Kelvin-Voigt model, None before contact has shown a stiffness."""
        stiffness, damping, offset = self._linear.parameters
        stiffness_n_m = stiffness * _MM
        doubt = math.sqrt(self._linear.variances()[0])
        if stiffness < _SURE * doubt or stiffness_n_m < _LEAST_STIFFNESS_N_M:
            return None
        return ContactModel(
            surface_m=self._origin_m - offset / stiffness_n_m,
            stiffness_n_m=min(stiffness_n_m, _LARGEST_STIFFNESS_N_M),
            damping_n_s_m=max(0.0, min(damping / _SPEED_SCALE, _LARGEST_DAMPING_N_S_M)),
        )

    def hunt_crossley(self) -> ContactModel | None:
        """Return the Hunt-Crossley model, None before contact has shown one."""
        logarithm, exponent, dissipation = self._power.parameters
        low, high = _EXPONENTS
        doubt = math.sqrt(self._power.variances()[1])
        if exponent < _SURE * doubt or not low <= exponent <= high:
            return None
        # The regression counts depth in mm.
        stiffness_n_m = math.exp(min(logarithm, 20.0)) * _MM**exponent
        return ContactModel(
            surface_m=self._onset_m,
            stiffness_n_m=stiffness_n_m,
            exponent=exponent,
            dissipation_s_m=max(0.0, min(dissipation / _SPEED_SCALE, _LARGEST_DISSIPATION_S_M)),
        )

    def best(self) -> ContactModel | None:
        """Return the model that has predicted the force better recently, None without any.

        Its stiffness is scaled by the share of the force's mean square that it has explained.
        """
        linear, power = self.kelvin_voigt(), self.hunt_crossley()
        chosen, error = linear, self._linear_error
        if power is not None and (linear is None or self._power_error < error):
            chosen, error = power, self._power_error
        explained = 1.0 - error / self._square if self._square > 0.0 else 0.0
        if chosen is None or explained < _LEAST_EXPLAINED:
            return None
        return replace(
            chosen,
            stiffness_n_m=explained * chosen.stiffness_n_m,
            damping_n_s_m=explained * chosen.damping_n_s_m,
        )

    def _detect(self, speed_m_s: float) -> None:
        """Detect the beginning and the end of contact, with hysteresis."""
        self._pull_n = max(self._pull_keep * self._pull_n, -self._force_n)
        pull_n = min(_PULL_MARGIN * self._pull_n, _PULL_SHARE * self.largest_n)
        threshold_n = max(self._settings.contact_n, pull_n)
        pushed = self.contact or self._stray
        if self._force_n > threshold_n * (0.5 if pushed else 1.0):
            outward = speed_m_s < (_STILL_M_S if self._stray else -_STILL_M_S)
            self._stray = not self.contact and outward
            if not (self.contact or self._stray):
                if not self.contacts:
                    self._origin_m = self._depth_m
                self._onset_m, self.contact = self._free_m, True
                self.contacts += 1
            return
        self.contact = self._stray = False
        if self._force_n < _FREE * threshold_n or not self.contacts:
            self._free_m = self._depth_m

    def _learn(self, speed: float) -> None:
        """Update with a sample of force, or of no force when a force was expected."""
        force_n = self._force_n if self.contact else 0.0
        linear = (_MM * (self._depth_m - self._origin_m), speed, 1.0)
        depth_m = self._depth_m - self._onset_m
        power = (1.0, math.log(_MM * max(depth_m, _SHALLOWEST_M)), speed)
        by_linear = max(0.0, self._linear.predict(linear))
        by_power = 0.0
        if depth_m > 0.0:
            by_power = math.exp(max(-20.0, min(self._power.predict(power), 20.0)))
        error = force_n - by_linear
        expected = by_linear > self._settings.contact_n
        if not (self.contact or expected or by_power > self._settings.contact_n):
            return
        if abs(speed) < _STILL_M_S / _SPEED_SCALE and abs(error) < _WRONG_N:
            return
        self._remember(force_n, error, force_n - by_power)
        if self.contact or expected:
            self._linear.update(linear, force_n)
        if self.contact:
            # Weighed by the force: an error of its logarithm is one of the force over it.
            weighed = (force_n, force_n * power[1], force_n * speed)
            self._power.update(weighed, force_n * math.log(force_n))
            self.samples += 1

    def _remember(self, force_n: float, linear: float, power: float) -> None:
        """Update the prediction errors of both models, before they are fitted to the sample."""
        share = 1.0 - self._error_keep
        self._square += share * (force_n * force_n - self._square)
        self._linear_error += share * (linear * linear - self._linear_error)
        self._power_error += share * (power * power - self._power_error)
