"""Courses made of recorded slides over real materials, laid one after the other.

The data are those of R. Gao et al. (BioTac_slide_20_50): a folder ``matN`` for each material, with
two files for each slide. ``matN_K_bio.csv`` holds the 22 samples of dynamic pressure that a BioTac
sends every 10 ms, ``matN_K_cw.csv`` the arm's force at 150 Hz. The finger slides for 6 to 8 s at
25 mm/s, while the force rises threefold. Pressure is used in place of acceleration; the data hold
its magnitude, which is used as it is.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import resample_poly, welch

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, frame_dtype
from mmt.evaluation.model_errors import band_membership
from mmt.testing.simulation import PERIOD_NS, PERIOD_S, RATE_HZ
from mmt_lab.harness.processes import map_in_processes
from mmt_lab.surfaces.running import COUNTS, SurfaceResult, follow

SLIDES: Final = "slides"
"""The group of sessions made of recorded slides."""

SPEED_MM_S: Final = 25.0
STAYS: Final = 10
"""Slides of a session, the first included."""

_FORCE_SHARE: Final = 0.18  # scales the arm's 4 to 17 N into the plane of 3 N
_M_S2: Final = 0.01  # for each count of pressure
_LANDING_S: Final = 0.3
_FADE: Final = 10
_LIFTED: Final = 300


@dataclass(frozen=True)
class Slide:
    """Vibration (m/s2) and normal force (N) of a slide, (n,) each, at 1 kHz."""

    vibration_m_s2: FloatArray
    force_n: FloatArray


@lru_cache(maxsize=512)
def read_slide(path: Path) -> Slide:
    """Read a slide by its ``_bio.csv`` and the ``_cw.csv`` beside it, without its landing."""
    try:
        bio = np.loadtxt(path, delimiter=",", skiprows=1, usecols=(0, *range(4, 26)))
        wrench = path.with_name(path.name.replace("_bio", "_cw"))
        arm = np.loadtxt(wrench, delimiter=",", skiprows=1, usecols=range(4))
    except (OSError, ValueError) as error:
        raise InputError(f"slide {path}: {error}") from error
    if len(bio) < 100 or len(arm) < 40:
        raise InputError(f"slide {path}: it is shorter than a second, or without force")
    pressure = bio[:, 1:].ravel()
    vibration = _M_S2 * resample_poly(pressure - pressure.mean(), 5, 11)
    time_s = bio[0, 0] + PERIOD_S * np.arange(len(vibration))
    force = np.interp(time_s, arm[:, 0], _FORCE_SHARE * np.linalg.norm(arm[:, 1:], axis=1))
    landed = round(_LANDING_S * RATE_HZ)
    return Slide(vibration[landed:], force[landed:])


def materials_in(folder: Path) -> dict[str, list[Path]]:
    """Return the slides of each material in a folder, two materials at least."""
    found = {each.name: sorted(each.glob("*_bio.csv")) for each in sorted(folder.glob("mat*"))}
    found = {name: slides for name, slides in found.items() if len(slides) >= STAYS}
    if len(found) < 2:
        raise InputError(
            f"--slides {folder}: needs two folders matN or more, each with {STAYS} matN_K_bio.csv "
            "or more"
        )
    return found


def run_slides(
    folder: Path, seeds: int, *, first: int = 0, workers: int | None = None
) -> list[SurfaceResult]:
    """Follow and score sessions of ten slides over 2 to 6 materials.

    Half of the changes happen within contact, at the others the finger is lifted for 0.3 s.
    Parameters are those of `mmt_lab.surfaces.running.run_simulated`; errors as of `materials_in`.
    """
    most = len(materials_in(folder))
    numbers = range(first, first + seeds)
    calls = [(folder, count, seed) for seed in numbers for count in COUNTS if count <= most]
    return map_in_processes(_followed, calls, workers=workers, what="sessions over recorded slides")


def _followed(folder: Path, count: int, seed: int) -> SurfaceResult:
    chance = random.Random(f"{count} {seed}")  # noqa: S311 - no secret
    known = materials_in(folder)
    names = chance.sample(list(known), count)
    unused = {name: chance.sample(known[name], len(known[name])) for name in names}
    order = [0]
    while len(order) < STAYS:
        order.append(chance.choice([n for n in range(count) if n != order[-1]]))
    slides = [read_slide(unused[names[place]].pop()) for place in order]
    lifted = [False] + [chance.random() < 0.5 for _ in order[1:]]
    frames, lengths = in_a_row(slides, lifted)
    name = f"{SLIDES}, {count} materials, seed {seed}"
    return replace(follow(name, names, np.repeat(order, lengths), frames), group=SLIDES)


def in_a_row(slides: Sequence[Slide], lifted: Sequence[bool]) -> tuple[RecordArray, list[int]]:
    """Return frames of slides one after the other, and the number of frames of each slide.

    ``lifted`` says before which slides the finger is off the surface; these frames count as theirs.
    """
    vibration: list[FloatArray] = []
    force: list[FloatArray] = []
    lengths = []
    for slide, off in zip(slides, lifted, strict=True):
        pause = np.zeros(_LIFTED * off)
        edge = np.minimum(np.arange(len(slide.force_n)), np.arange(len(slide.force_n))[::-1])
        vibration += [pause, slide.vibration_m_s2 * np.minimum(1.0, (edge + 0.5) / _FADE)]
        force += [pause, slide.force_n]
        lengths.append(len(pause) + len(slide.force_n))
    count = sum(lengths)
    frames = np.zeros(count, frame_dtype(CHANNELS))
    frames["sequence"] = np.arange(count)
    frames["time_ns"] = PERIOD_NS * np.arange(count)
    frames["position_mm"][:, 0] = SPEED_MM_S * PERIOD_S * np.arange(count)
    frames["force_n"][:, 2] = np.concatenate(force)
    frames["acceleration_m_s2"][:, 2] = np.concatenate(vibration)
    return frames, lengths


def scatter_db(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Return the scatter of the level between slides in each band of `BAND_EDGES_HZ`, dB.

    Returns
    -------
    within, between
        Standard deviation between whole slides over one material, root mean square over the
        materials; and between the materials' means. Shape (9,) each.
    """
    levels = [
        np.array([_band_levels(read_slide(path).vibration_m_s2) for path in slides])
        for slides in materials_in(folder).values()
    ]
    within = np.sqrt(np.mean([level.var(axis=0, ddof=1) for level in levels], axis=0))
    return within, np.std([level.mean(axis=0) for level in levels], axis=0, ddof=1)


def _band_levels(vibration: FloatArray) -> FloatArray:
    frequencies, density = welch(vibration, RATE_HZ, nperseg=1000)
    return np.asarray(10.0 * np.log10(density @ band_membership(frequencies)))
