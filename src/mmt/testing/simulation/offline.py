"""A whole simulated session at once, as fast as the machine allows."""

from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.bounds import check
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.scene import Hand, Scene, Simulated
from mmt.testing.simulation import RATE_HZ, nominal_compliance_mm_n
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.instruments import Instruments
from mmt.testing.simulation.recorded_path import RecordedPath, load_path
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.surfaces.course import SurfaceCourse, surface_of
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface
from mmt.testing.simulation.surfaces.textures import get_surface

_BLOCK_TICKS: Final = 1000
_STILL_MM_S: Final = 4.0
"""Speed over which friction sets in on a recorded path."""


def simulate_session(
    scene: Scene,
    surface: str | KnownSurface | SurfaceCourse | None = None,
    duration_s: float | None = None,
    seed: int | None = None,
    *,
    path: Path | None = None,
    motion_scale: float = 1.0,
    force_scale: float = 1.0,
) -> tuple[RecordArray, bytes]:
    """Simulate the frames that a follower sends over a link without delay.

    Parameters
    ----------
    scene
        Its ``[simulated]`` and ``[hand]`` are used, or their defaults; force is fed back to
        the hand if it has ``[force_feedback]``.
    surface, duration_s, seed
        In place of the scene's own; a surface object must have the scene's rate.
    path
        A recorded stroke (see `load_path`) that is replayed in place of the hand's and
        the robot's motion, looped as long as the session lasts.
    motion_scale, force_scale
        Factors on the recorded stroke's motion and force.

    Returns
    -------
    frames
        Shape (n,), every channel, time from 0.
    annotations
        The surface's truth.

    Raises
    ------
    InputError
        The surface, the duration, a scale or the path's file is not usable, or the surface is not
        at the scene's ``acceleration_rate_hz``.
    """
    check("scene", scene, Scene)
    check("duration_s", duration_s, float | None)
    check("seed", seed, int | None)
    settings = scene.simulated or Simulated()
    seed = scene.session.seed if seed is None else seed
    duration_s = scene.session.duration_s if duration_s is None else duration_s
    rate_hz = float(scene.session.acceleration_rate_hz)
    known = surface or surface_of(settings, duration_s, seed, rate_hz)
    if isinstance(known, str):
        known = get_surface(known, rate_hz)
    if known.rate_hz != rate_hz:
        raise InputError(
            f"surface {known.name} is at {known.rate_hz:g} Hz, the scene's acceleration at "
            f"{rate_hz:g} Hz (acceleration_rate_hz of [session])"
        )
    if not (isfinite(duration_s) and duration_s * RATE_HZ >= 1):
        raise InputError(f"duration_s is {duration_s}, it must be above 0")
    count = round(duration_s * RATE_HZ)
    if path is None:
        follower = SimulatedFollower(settings, channels=CHANNELS, seed=seed, surface=known)
        hand = SimulatedHand(
            scene.hand or Hand(), seed, compliance_mm_n=nominal_compliance_mm_n(settings)
        )
        frames = _stroked(follower, hand, count, feel=scene.force_feedback is not None)
    else:
        stroke = load_path(path).scaled(motion_scale, force_scale).looped(count)
        frames = _replayed(stroke, settings, known, seed)
    return frames, known.annotations()


def _stroked(
    follower: SimulatedFollower, hand: SimulatedHand, count: int, *, feel: bool
) -> RecordArray:
    follower.start(0)
    joined = bytearray()
    for _ in range(count):
        frames = follower.step(1, 0, hand.read(1).position_mm)
        if feel:
            x, y, z = frames["force_n"][0].tolist()
            hand.write((x, y, z))
        joined += frames.tobytes()
    return np.frombuffer(joined, follower.dtype)


def _replayed(
    stroke: RecordedPath, settings: Simulated, surface: KnownSurface | SurfaceCourse, seed: int
) -> RecordArray:
    instruments = Instruments(surface, CHANNELS, seed, noise=settings.noise)
    tips = _tips(stroke, settings, surface)
    edges = [*range(0, len(tips), _BLOCK_TICKS), len(tips)]
    return np.concatenate([instruments.frames(tips[start:stop]) for start, stop in pairwise(edges)])


def _tips(
    stroke: RecordedPath, settings: Simulated, surface: KnownSurface | SurfaceCourse
) -> list[TipState]:
    """Return the true tip at every tick of a recorded stroke.

    A recording without height gets the depth that its force presses into the surface.
    """
    position = stroke.position_mm.copy()
    if not position[:, 2].any():
        position[:, 2] = -stroke.force_n / settings.surface_stiffness_n_mm
    velocity = _slope(position)
    acceleration = 0.001 * _slope(velocity)
    if not stroke.position_mm[:, 2].any():
        acceleration[:, 2] = 0.0
    speed = np.hypot(velocity[:, 0], velocity[:, 1])[:, None]
    force = np.empty_like(position)
    grip = _friction(surface, stroke.force_n) * stroke.force_n
    force[:, :2] = -grip[:, None] * velocity[:, :2] / np.hypot(speed, _STILL_MM_S)
    force[:, 2] = stroke.force_n
    rows = np.concatenate([position, velocity, force, acceleration], axis=1).tolist()
    return [
        TipState(
            (row[0], row[1], row[2]),
            (row[3], row[4], row[5]),
            (row[6], row[7], row[8]),
            (row[9], row[10], row[11]),
        )
        for row in rows
    ]


def _friction(surface: KnownSurface | SurfaceCourse, force_n: FloatArray) -> FloatArray:
    """Return the friction coefficient under the tool at each tick, from the force (n,)."""
    if isinstance(surface, SurfaceCourse):
        coefficients = np.array([one.friction_coefficient for one in surface.surfaces])
        return coefficients[surface.places_by_frame(force_n)]
    return np.full_like(force_n, surface.friction_coefficient)


def _slope(values: FloatArray) -> FloatArray:
    if len(values) < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, axis=0), dtype=np.float64) * RATE_HZ
