"""Simulated sessions of known textures, and the cases made of them on which methods are judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from mmt.core.arrays import RecordArray
from mmt.scene import Link, Scene, SessionTable, Simulated, Texture
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.texture.settings import Inputs
from mmt_lab.harness.experiment import hand_of


@cache
def session(
    surface: str, duration_s: float, seed: int = 1, acceleration_rate_hz: int = 1000
) -> RecordedSession:
    """Return a simulated session on a known texture, from the cache if there is one."""
    scene = Scene(session=SessionTable(acceleration_rate_hz=acceleration_rate_hz))
    frames, annotations = simulate_session(scene, surface, duration_s, seed)
    return RecordedSession(frames=frames, annotations=annotations)


INHOMOGENEOUS: Final = ("plastic+patches", "plastic+bursts-4", "plastic+bursts-8")
"""Textures whose level differs from place to place, or comes in bursts of 25 ms."""

FIRST_SEED: Final = 1000
"""First seed of the cases; smaller seeds were used in development."""

DURATION_S: Final = 30.0
"""Length of a session. With all headings the stop criterion is met after 20 to 27 s."""


@dataclass(frozen=True)
class ComparisonCase:
    """One session: a known texture, a seed, a kind of hand, sensors with or without noise."""

    texture: str
    seed: int
    hand: str = "strokes"
    noise: bool = True
    acceleration_rate_hz: int = 1000

    @property
    def surface(self) -> KnownSurface:
        """The known texture, at the sampling rate of the acceleration."""
        return get_surface(self.texture, float(self.acceleration_rate_hz))

    @property
    def samples_per_frame(self) -> int:
        """Samples of acceleration in a frame."""
        return self.acceleration_rate_hz // 1000

    @property
    def _at_rate(self) -> str:
        return f" at {self.samples_per_frame} kHz" if self.samples_per_frame > 1 else ""

    @property
    def group(self) -> str:
        """Group of textures whose results are pooled; each rate above 1 kHz has its own."""
        return self._kind + self._at_rate

    @property
    def _kind(self) -> str:
        if not get_surface(self.texture).isotropic:
            return "grained"
        if "+" in self.texture:
            return "inhomogeneous"
        return "isotropic" if self.texture in SURFACES else "drawn and models"

    @property
    def name(self) -> str:
        """Name under which the seeds of a texture and rate are pooled."""
        return Path(self.texture).name + self._at_rate

    @property
    def labels(self) -> dict[str, Any]:
        """Labels of every figure of the case: group, name, texture, seed and rate."""
        return {
            "group": self.group,
            "name": self.name,
            "texture": self.texture,
            "seed": self.seed,
            "acceleration_rate_hz": self.acceleration_rate_hz,
        }

    @property
    def inputs(self) -> Inputs:
        """Inputs of the models of all methods."""
        return "isotropic" if get_surface(self.texture).isotropic else "anisotropic"

    def session(self) -> RecordArray:
        """Simulate the session; the hand takes all headings if the texture depends on them."""
        grained = self.inputs == "anisotropic"
        scene = Scene(
            session=SessionTable(acceleration_rate_hz=self.acceleration_rate_hz),
            link=Link(),
            texture=Texture(),
            simulated=Simulated(noise=self.noise),
            hand=hand_of(self.hand, isotropic=not grained),
        )
        return simulate_session(scene, self.texture, DURATION_S, self.seed)[0]


def simulated_cases(
    seeds: int, textures: Sequence[str], hand: str = "strokes", *, noise: bool = True
) -> list[ComparisonCase]:
    """Return cases of each texture with `seeds` seeds each, by a kind of hand.

    No two cases share a seed, with which the hand would stroke in the same way.
    """
    return [
        ComparisonCase(name, FIRST_SEED + number * seeds + seed, hand=hand, noise=noise)
        for number, name in enumerate(textures)
        for seed in range(seeds)
    ]
