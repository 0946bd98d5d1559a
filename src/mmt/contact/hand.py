"""Contact force at the hand, from the hand's motion and a contact learned at the follower.

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
from typing import Final

from mmt.contact.estimation import ContactEstimator, EstimationSettings
from mmt.contact.force_map import SmoothSpeed

_RENEWAL: Final = 10
"""Number of samples between two queries of the estimate, which cost more than a sample."""
_LEAST_M2: Final = 1e-8
"""Least sum of squared depths in moving contact for a known stiffness: one depth of 0.1 mm."""
_REGULARISER: Final = 1e-12


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

    def update(self, command_m: float, place_m: float, force_n: float) -> None:
        """Learn from one sample of the follower; one that is not finite is ignored.

        Parameters
        ----------
        command_m, place_m
            Commanded and measured position of the tool along the axis into the surface.
        force_n
            Force of the surface on the tool.
        """
        if not math.isfinite(command_m + place_m + force_n):
            return
        self.surface.update(place_m, force_n)
        speed_m_s = self._speed.step(command_m, self._tick_s)
        self._samples += 1
        if self._samples % _RENEWAL == 0:
            model = self.surface.best()
            self.surface_m = self.surface_m if model is None else model.surface_m
        if self.surface_m is not None and self.surface.contact and command_m > self.surface_m:
            self._fit(command_m - self.surface_m, speed_m_s, force_n)

    def _fit(self, depth_m: float, speed_m_s: float, force_n: float) -> None:
        new = (
            depth_m * depth_m,
            depth_m * speed_m_s,
            speed_m_s * speed_m_s,
            depth_m * force_n,
            speed_m_s * force_n,
        )
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
