"""Delay from which force feedback is unstable, by linear theory.

The position-force architecture (Hannaford and Anderson, "Experimental and simulation studies
of hard contact in force reflecting teleoperation", ICRA 1988; Lawrence, "Stability and
transparency in bilateral teleoperation", IEEE Trans. Robot. Autom. 9 (1993)): the handle's
position is the follower's command, the surface's force on the tool is shown on the handle.
Around a steady contact all of it is linear, and one loop::

    L(s) = Y(s) G(s) exp(-s T)

with Y = 1 / (m s^2 + b s + k) the hand on the handle from force to position, G the follower
from command to contact force (`tip_drive` on a spring wall), and T the way there and back
plus one sample: half of one until the mean force of a tick is known and half for holding it.
The loop is stable if L does not encircle -1 (Nyquist); if |L| < 1 at every frequency, the loop is
stable for every delay.
"""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from mmt.contact.steps import Drive
from mmt.core.arrays import FloatArray
from mmt.testing.simulation import PERIOD_S
from mmt.testing.simulation.robot import DISSIPATION_S_M, tip_drive

LIGHT_GRIP: Final = Drive(mass_kg=0.1, stiffness_n_m=300.0, damping_n_s_m=15.0)
"""Hand and handle in a light grip; our choice, of the order of values measured at a stylus
(Fu and Cavusoglu, IEEE Trans. Syst. Man Cybern. B 42 (2012))."""
BANDWIDTH_HZ: Final = 15.0
CONTACT_N: Final = 1.0

_FREQUENCIES_RAD_S: Final[FloatArray] = np.geomspace(0.01, 1e5, 60_000)


def loop_gain(wall_n_mm: float, angular_rad_s: FloatArray) -> npt.NDArray[np.complex128]:
    """Return Y G, the loop without its delay, at frequencies (f,).

    The wall's Hunt-Crossley damping grows with the contact's force.
    """
    s = 1j * angular_rad_s
    drive, pole = tip_drive(BANDWIDTH_HZ)
    wall = 1000.0 * wall_n_mm + DISSIPATION_S_M * CONTACT_N * s
    grip = LIGHT_GRIP
    hand = grip.mass_kg * s * s + grip.damping_n_s_m * s + grip.stiffness_n_m
    arm = drive.mass_kg * s * s + drive.damping_n_s_m * s + drive.stiffness_n_m
    gain: npt.NDArray[np.complex128] = (
        drive.stiffness_n_m * wall / (arm + wall) * pole / (s + pole) / hand
    )
    return gain


def critical_delay_s(wall_n_mm: float) -> float:
    """Return the delay there and back from which the loop is unstable; infinity if none.

    This is the smallest delay at which L passes through -1: at each frequency with |YG| = 1,
    phase plus pi, divided by the frequency. It is negative if the loop is unstable without any
    delay. One sample is subtracted for the digital loop.
    """
    gain = loop_gain(wall_n_mm, _FREQUENCIES_RAD_S)
    level = np.log(np.abs(gain))
    phase = np.unwrap(np.angle(gain))
    crossings = np.flatnonzero(np.diff(np.sign(level)) != 0)
    delays = []
    for index in crossings:
        share = level[index] / (level[index] - level[index + 1])
        at = slice(index, index + 2)
        angular = np.interp(share, (0.0, 1.0), _FREQUENCIES_RAD_S[at])
        delays.append((np.interp(share, (0.0, 1.0), phase[at]) + math.pi) / angular)
    return min(delays, default=math.inf) - PERIOD_S
