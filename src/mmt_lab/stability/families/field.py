"""The field of a level: very many blocks, one stroke repeated, any powers, unsteady levels."""

import time
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.evaluation.model_errors import root_mean_square
from mmt.texture.field.cells import LARGEST, MOMENT_BLOCKS, FieldCells
from mmt.texture.field.covariance import coordinates
from mmt.texture.field.posterior import LevelField
from mmt_lab.stability.families import CaseResult, Extreme, Family

MANY: Final = 100_000

_ASKED: Final = 200
_SCATTER: Final = 0.4  # nepers, of a block's power


def cases(*, many: int = MANY) -> list[Extreme]:
    """Return the family's cases, the largest of `many` blocks."""
    return [
        *(
            Extreme(
                f"{many} blocks, {'velocity and force' if directed else 'speed and force'}",
                f"at most {LARGEST} rows, an update linear in new blocks, error as large as stated",
                partial(_many, many, directed),
            )
            for directed in (False, True)
        ),
        Extreme("one stroke repeated", "sure there, unsure far away", _repeated),
        Extreme("powers of 0 and 1e-300 to 1e300", "finite level and deviation", _any_power),
        Extreme(
            "moments that differ by 3 dB", "stated deviation 0.7 to 2.2 times the error", _unsteady
        ),
        Extreme("bursts of kurtosis 8", "stated deviation 0.7 to 2.2 times the error", _bursts),
    ]


def _points(count: int, directed: bool, seed: int) -> FloatArray:
    random = np.random.default_rng(seed)
    speed, force = random.uniform(0.05, 1.0, (2, count))
    if not directed:
        return np.column_stack([speed, force])
    heading = random.uniform(-np.pi, np.pi, count)
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading), force])


def _law(points: FloatArray) -> FloatArray:
    at = coordinates(points)
    return np.asarray(1.2 * at.u + 0.6 * at.v)


def _felt(count: int, directed: bool = False, seed: int = 1) -> FieldCells:
    random = np.random.default_rng(seed)
    points = _points(count, directed, seed)
    scatter = _SCATTER * random.standard_normal(count) - 0.5 * _SCATTER**2
    number = random.integers(0, 20 * count, count)
    return FieldCells.from_blocks(points, np.exp(_law(points) + scatter), number)


def _many(many: int, directed: bool) -> CaseResult:
    cells = _felt(many, directed)
    started = time.thread_time()
    cells = cells.joined(_felt(20, directed, seed=2))
    joining_ms = 1e3 * (time.thread_time() - started)
    started = time.thread_time()
    field = LevelField(cells)
    table = field.table
    solving_ms = 1e3 * (time.thread_time() - started)
    asked = _points(_ASKED, directed, 3)
    mean, deviation = field.level_db(asked)
    error = mean - _decibel(_law(asked))
    rms = root_mean_square(error)
    return CaseResult(
        f"{len(cells)} rows, 20 more blocks {joining_ms:.1f} ms, posterior and table "
        f"{solving_ms:.0f} ms, error {rms:.2f} dB, stated {deviation.mean():.2f} dB",
        held=bool(
            len(cells) <= LARGEST
            and np.isfinite(table).all()
            and rms < 0.5
            and rms < 2.0 * deviation.mean()
        ),
        figures={"rows": len(cells), "solving_ms": solving_ms, "error_db": rms},
    )


def _repeated() -> CaseResult:
    points = np.tile([[0.4, 0.5]], (10_000, 1))
    field = LevelField(
        FieldCells.from_blocks(points, np.full(len(points), 2.0), np.arange(len(points)))
    )
    mean, deviation = field.level_db(np.array([[0.4, 0.5], [0.05, 0.05], [1.0, 1.0]]))
    off = abs(float(mean[0]) - float(_decibel(np.log(np.array([2.0])))[0]))
    return CaseResult(
        f"there off by {off:.2f} dB, {deviation[0]:.2f} dB stated; "
        f"far {deviation[1:].min():.1f} dB",
        held=bool(off < 0.5 and deviation[0] < 2.0 < deviation[1:].min()),
        figures={"off_db": off},
    )


def _any_power() -> CaseResult:
    power = 10.0 ** np.random.default_rng(6).uniform(-300.0, 300.0, 500)
    power[::7] = 0.0
    points = _points(len(power), False, 6)
    field = LevelField(FieldCells.from_blocks(points, power, np.arange(len(power))))
    found = np.concatenate([*field.level_db(points), field.table.ravel()])
    finite = bool(np.isfinite(found).all())
    return CaseResult("all finite" if finite else "not finite", held=finite)


def _unsteady() -> CaseResult:
    def gains(random: np.random.Generator, moment: IntArray) -> FloatArray:
        level = 0.69 * random.standard_normal(int(moment.max()) + 1) - 0.5 * 0.69**2
        return np.asarray(np.exp(level[moment]))

    return _calibrated(gains)


def _bursts() -> CaseResult:
    spread = float(np.sqrt(np.log(8.0 / 3.0)))

    def gains(random: np.random.Generator, moment: IntArray) -> FloatArray:
        level = spread * random.standard_normal((len(moment), 2)) - 0.5 * spread**2
        return np.asarray(np.exp(level).mean(axis=1))

    return _calibrated(gains)


def _calibrated(gains: Callable[[np.random.Generator, IntArray], FloatArray]) -> CaseResult:
    squares = []
    asked = _points(_ASKED, False, 8)
    for seed in range(20):
        random = np.random.default_rng(seed)
        points = np.repeat(_points(80, False, seed), 5, axis=0)
        number = np.repeat(np.arange(80) * MOMENT_BLOCKS, 5)
        power = np.exp(_law(points)) * random.chisquare(13.0, 400) / 13.0
        power *= gains(random, number // MOMENT_BLOCKS)
        field = LevelField(FieldCells.from_blocks(points, power, number))
        mean, deviation = field.level_db(asked)
        squares.append(np.mean(np.square((mean - _decibel(_law(asked))) / deviation)))
    standardised = float(np.sqrt(np.mean(squares)))
    return CaseResult(
        f"error {standardised:.2f} stated deviations",
        held=0.45 < standardised < 1.4,  # these truths are smoother than the prior's textures
        figures={"standardised": standardised},
    )


def _decibel(nepers: FloatArray) -> FloatArray:
    return np.asarray(10.0 / np.log(10.0) * nepers)


FAMILY: Final = Family("The field of a level", cases)
