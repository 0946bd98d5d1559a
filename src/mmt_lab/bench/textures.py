"""Simulated sessions on known textures, cached within a process."""

from functools import cache

from mmt.scene import Scene, SessionTable
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session


@cache
def session(
    surface: str, duration_s: float, seed: int = 1, acceleration_rate_hz: int = 1000
) -> RecordedSession:
    """Return a simulated session on a known texture, from the cache if there is one."""
    scene = Scene(session=SessionTable(acceleration_rate_hz=acceleration_rate_hz))
    frames, annotations = simulate_session(scene, surface, duration_s, seed)
    return RecordedSession(frames=frames, annotations=annotations)
