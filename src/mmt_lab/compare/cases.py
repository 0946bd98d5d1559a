"""What methods are judged on: simulated sessions of every known texture, and recorded strokes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.scene import Link, Scene, SessionTable, Simulated, Texture
from mmt.testing.simulation.known_surfaces import KnownSurface
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.recorded_path import LARGEST_SCALE, load_path
from mmt.testing.simulation.textures import SURFACES, get_surface
from mmt.texture.settings import Inputs
from mmt_lab.harness.experiment import hand_of

INHOMOGENEOUS: Final = ("plastic+patches", "plastic+bursts-4", "plastic+bursts-8")
"""Textures whose level differs from place to place, or comes in bursts of 25 ms."""

FIRST_SEED: Final = 1000
"""Seeds count from here: the ones that anything was tried with are smaller."""

DURATION_S: Final = 30.0
"""A hand that takes all headings meets the stop criterion of three inputs after 20 to 27 s."""

FASTEST_MM_S: Final = 200.0
STRONGEST_N: Final = 2.0
"""Recorded strokes are scaled so that these are their 95th percentiles."""

_SLOWEST_MM_S: Final = 20.0
_LIGHTEST_N: Final = 0.1
_PERCENTILE: Final = 95.0


@dataclass(frozen=True)
class ComparisonCase:
    """One session.

    Attributes
    ----------
    texture
        The known texture.
    seed
        Seed of all random numbers.
    stroke
        A recorded stroke in place of the simulated hand, None without.
    motion_scale, force_scale
        Factors on it.
    hand
        Kind of the simulated hand.
    noise
        Whether the sensors have noise and a resolution.
    acceleration_rate_hz
        Rate of the acceleration.
    """

    texture: str
    seed: int
    stroke: Path | None = None
    motion_scale: float = 1.0
    force_scale: float = 1.0
    hand: str = "strokes"
    noise: bool = True
    acceleration_rate_hz: int = 1000

    @property
    def surface(self) -> KnownSurface:
        """The texture at the rate of the acceleration."""
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
        """What it is counted with."""
        return self._kind + self._at_rate

    @property
    def _kind(self) -> str:
        if self.stroke is not None:
            return "recorded strokes"
        if not get_surface(self.texture).isotropic:
            return "grained"
        if "+" in self.texture:
            return "inhomogeneous"
        return "isotropic" if self.texture in SURFACES else "drawn and models"

    @property
    def name(self) -> str:
        """The texture, or the recorded stroke, over which seeds, or textures, are gathered."""
        name = Path(self.texture).name if self.stroke is None else self.stroke.stem
        return name + self._at_rate

    @property
    def labels(self) -> dict[str, Any]:
        """What every figure of it is labelled with: group, name, texture, seed and rate."""
        return {
            "group": self.group,
            "name": self.name,
            "texture": self.texture,
            "seed": self.seed,
            "acceleration_rate_hz": self.acceleration_rate_hz,
        }

    @property
    def inputs(self) -> Inputs:
        """What the models of all methods are functions of."""
        return "isotropic" if get_surface(self.texture).isotropic else "anisotropic"

    def session(self) -> RecordArray:
        """Simulate the session: a hand that takes all headings where they count."""
        grained = self.inputs == "anisotropic"
        scene = Scene(
            session=SessionTable(acceleration_rate_hz=self.acceleration_rate_hz),
            link=Link(),
            texture=Texture(),
            simulated=Simulated(noise=self.noise),
            hand=hand_of(self.hand, isotropic=not grained),
        )
        frames, _ = simulate_session(
            scene,
            self.texture,
            DURATION_S,
            self.seed,
            path=self.stroke,
            motion_scale=self.motion_scale,
            force_scale=self.force_scale,
        )
        return frames


def simulated_cases(
    seeds: int, textures: Sequence[str], hand: str = "strokes", *, noise: bool = True
) -> list[ComparisonCase]:
    """Return a session of each texture and each of a number of seeds, by a kind of hand.

    No two sessions have the same seed: the hand would stroke in the same way.
    """
    return [
        ComparisonCase(name, FIRST_SEED + number * seeds + seed, hand=hand, noise=noise)
        for number, name in enumerate(textures)
        for seed in range(seeds)
    ]


def recorded_cases(
    paths: Sequence[Path], textures: Sequence[str] | None = None
) -> tuple[list[ComparisonCase], list[str]]:
    """Return a session of each recorded stroke on each isotropic texture, and what was left out.

    A stroke in one direction says nothing of a texture that depends on the heading.

    Parameters
    ----------
    paths
        Recordings as `load_path` reads them, or folders of them.
    textures
        Names, None for all.

    Returns
    -------
    cases, remarks
        A remark for each recording or folder that is not used, with the reason.
    """
    chosen = [
        name
        for name, surface in SURFACES.items()
        if surface.isotropic and (textures is None or name in textures)
    ]
    cases: list[ComparisonCase] = []
    remarks: list[str] = []
    for path in paths:
        files = sorted(path.rglob("[!.]*.npz")) if path.is_dir() else [path]
        if not path.exists() or not files:
            remarks.append(f"{path}: skipped, there is no recorded stroke (.npz)")
            continue
        for file in files:
            try:
                motion, force = _scales(file)
            except InputError as error:
                remarks.append(f"skipped: {error}")
                continue
            cases += [
                ComparisonCase(name, FIRST_SEED + number, file, motion, force)
                for number, name in enumerate(chosen)
            ]
    return cases, remarks


def _scales(path: Path) -> tuple[float, float]:
    """Return the factors that bring a stroke into the plane."""
    stroke = load_path(path)
    velocity = np.gradient(stroke.position_mm[:, :2], 1e-3, axis=0)
    speed_mm_s = float(np.percentile(np.hypot(*velocity.T), _PERCENTILE))
    force_n = float(np.percentile(stroke.force_n, _PERCENTILE))
    if speed_mm_s < _SLOWEST_MM_S or force_n < _LIGHTEST_N:
        raise InputError(
            f"{path}: 95 % of it is slower than {speed_mm_s:.0f} mm/s and lighter than "
            f"{force_n:.2f} N, which is no stroking"
        )
    return (
        min(FASTEST_MM_S / speed_mm_s, LARGEST_SCALE),
        min(STRONGEST_N / force_n, LARGEST_SCALE),
    )
