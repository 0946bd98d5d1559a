"""The closest forces that a passive display can show."""

import numpy as np
from scipy.optimize import isotonic_regression

from mmt.core.arrays import FloatArray


def closest_passive(force_n: FloatArray, travel_m: FloatArray, energy_j: float) -> FloatArray:
    """Return the passive forces (n,) that are closest to the given ones in their mean square.

    A port that gives the hand no more energy than it got and a reserve cannot show every force:
    one that drives the hand along costs energy that must have been put in before. The closest
    forces that it can show, where the whole recording is known beforehand, minimise

        sum (s_t - f_t)^2   subject to   sum_{u <= t} s_u dx_u >= -E   for every t,

    with travel dx into the surface and E the energy at the beginning. By its multipliers,
    ``s_t = f_t + b_t dx_t``: a damper b that never grows and is never negative. The dual problem
    is the weighted isotonic regression of ``-f_t / dx_t`` with weights ``dx_t^2`` (Best and
    Chakravarti, "Active set algorithms for isotonic regression", Math. Programming 47 (1990)).

    Parameters
    ----------
    force_n
        Force against the travel, (n,), each held while the hand travels.
    travel_m
        The hand's travel in each tick, (n,).
    energy_j
        Energy that may be given before any was put in, at least 0.
    """
    shown = np.array(force_n, dtype=float)
    moving = np.flatnonzero(travel_m)
    if not len(moving):
        return shown
    travel = travel_m[moving]
    weights = travel * travel
    wanted = -shown[moving] / travel
    wanted[0] -= energy_j / weights[0]
    damping = isotonic_regression(wanted, weights=weights, increasing=False).x
    shown[moving] += np.maximum(damping, 0.0) * travel
    return shown


def least_shown(
    force_n: FloatArray, travel_m: FloatArray, energy_j: float, known_from: int
) -> FloatArray:
    """Return the closest passive forces (n,) of a display that shows nothing at first.

    Parameters
    ----------
    force_n, travel_m, energy_j
        As in `closest_passive`.
    known_from
        Tick at which the first contact has arrived; from then on everything is known.
    """
    shown = np.zeros(len(force_n))
    late = slice(known_from, None)
    shown[late] = closest_passive(force_n[late], travel_m[late], energy_j)
    return shown
