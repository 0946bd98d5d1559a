"""Conversion of six raw values to a force in the scene's axes, with a check for overload."""

import math
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]


class WrenchOptions(BaseModel):
    """Mounting of a force sensor, and when it is lost."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mounted: Literal["tool", "surface"] = "tool"
    """Whether the sensor carries the tool or the surface; at the surface the sign is opposite."""
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    """Turns the sensor's axes into the scene's: about x, then y, then z of the scene."""
    latency_ms: float | None = Field(default=None, ge=0, le=1000)
    """Time from the force to the sensor's stamp; None for the driver's own figure."""
    silence_ms: float = Field(default=200, ge=20, le=10_000)
    """Time without a record after which the sensor is lost."""
    stuck_ms: float = Field(default=500, ge=0, le=60_000)
    """Time with exactly the same values after which the sensor is lost; 0 for never."""


Six = tuple[float, float, float, float, float, float]
"""Counts or volts of a record, in the order of the matrix's columns; or a wrench: Fx, Fy, Fz
(N), Tx, Ty, Tz (N mm)."""
Matrix = tuple[Six, Six, Six, Six, Six, Six]
"""Rows Fx, Fy, Fz (N), Tx, Ty, Tz (N mm) per unit of a raw value."""

_ZERO: Final[Six] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IMPOSSIBLE: Final = 4.0
"""A record beyond this many times the calibrated range is broken: no gauge follows that far."""
_UNREST: Final = 0.02
"""Share of the range; with a larger standard deviation the tool is not at rest for a bias."""


def diagonal(per_force_n: float, per_torque_n_mm: float) -> Matrix:
    """Return the matrix of a device that computes the wrench itself."""
    factors = (per_force_n,) * 3 + (per_torque_n_mm,) * 3
    rows = [[0.0] * 6 for _ in range(6)]
    for i, factor in enumerate(factors):
        rows[i][i] = factor
    return matrix_of(rows)


def matrix_of(rows: Sequence[Sequence[float]]) -> Matrix:
    """Return six rows of six as a matrix.

    Raises
    ------
    ValueError
        There are not six rows of six values, or a value is not finite.
    """
    if len(rows) != 6 or any(len(row) != 6 for row in rows):
        raise ValueError("it is not 6 x 6")
    if not all(math.isfinite(value) for row in rows for value in row):
        raise ValueError("it has values that are not finite")
    a, b, c, d, e, f = (six_of(row) for row in rows)
    return a, b, c, d, e, f


def six_of(values: Sequence[float]) -> Six:
    """Return six values as floats."""
    u, v, w, x, y, z = (float(value) for value in values)
    return u, v, w, x, y, z


def orientation(options: WrenchOptions) -> tuple[Vector, Vector, Vector]:
    """Return the rows that turn a force in the sensor's axes into the scene's.

    They turn about the scene's x, then y, then z. A sensor that carries the surface measures
    the opposite of the force on the tool.
    """
    x, y, z = (math.radians(angle) for angle in options.rotation_deg)
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(a), math.sin(a)) for a in (x, y, z))
    sign = 1.0 if options.mounted == "tool" else -1.0
    rows = (
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (-sy, cy * sx, cy * cx),
    )
    first, second, third = ((sign * a, sign * b, sign * c) for a, b, c in rows)
    return first, second, third


class WrenchConverter:
    """Turn raw values into forces; the bias is kept in raw values.

    Parameters
    ----------
    matrix
        From raw values to the wrench in the sensor's axes.
    limits
        The calibrated range: Fx, Fy, Fz (N), Tx, Ty, Tz (N mm).
    options
        Mounting of the sensor.
    faults
        Counts go here: ``overload`` (records beyond the calibrated range), and ``impossible
        value`` (records left out).
    """

    def __init__(
        self, matrix: Matrix, limits: Six, options: WrenchOptions, faults: Counter[str]
    ) -> None:
        self.faults = faults
        self._matrix = matrix
        self._limits = limits
        self._x, self._y, self._z = (
            six_of([sum(turn[i] * matrix[i][j] for i in range(3)) for j in range(6)])
            for turn in orientation(options)
        )
        self._safe = _within(matrix, self._limits)
        self.bias: Six = _ZERO

    def force(self, raw: Six) -> Vector | None:
        """Return the force in the scene's axes (N), or None if the record is impossible."""
        p, q, r, s, t, u = raw
        i, j, k, m, n, o = self.bias
        p, q, r, s, t, u = p - i, q - j, r - k, s - m, t - n, u - o
        i, j, k, m, n, o = self._safe
        if not (
            abs(p) <= i and abs(q) <= j and abs(r) <= k
            and abs(s) <= m and abs(t) <= n and abs(u) <= o
        ):  # fmt: skip
            beyond = self._is_beyond((p, q, r, s, t, u))
            if beyond is None:
                self.faults["impossible value"] += 1
                return None
            self.faults["overload"] += beyond
        (a, b, c, d, e, f), (aa, bb, cc, dd, ee, ff) = self._x, self._y
        x = a * p + b * q + c * r + d * s + e * t + f * u
        y = aa * p + bb * q + cc * r + dd * s + ee * t + ff * u
        a, b, c, d, e, f = self._z
        return (x, y, a * p + b * q + c * r + d * s + e * t + f * u)

    def _is_beyond(self, values: Six) -> bool | None:
        """Return whether a part of the wrench exceeds its limit, None if it is impossible."""
        p, q, r, s, t, u = values
        beyond = False
        for (a, b, c, d, e, f), limit in zip(self._matrix, self._limits, strict=True):
            size = abs(a * p + b * q + c * r + d * s + e * t + f * u)
            if not size <= limit:
                if not size <= IMPOSSIBLE * limit:
                    return None
                beyond = True
        return beyond

    def take_bias(self, records: Sequence[Six], device: str) -> None:
        """Take the mean of records as the bias; the tool must be free and at rest.

        Raises
        ------
        MmtError
            The force changed meanwhile.
        """
        count = len(records)
        mean = six_of([math.fsum(column) / count for column in zip(*records, strict=True)])
        for axis, name in enumerate("xyz"):
            row, limit = self._matrix[axis], self._limits[axis]
            forces = [
                sum(a * (b - m) for a, b, m in zip(row, raw, mean, strict=True)) for raw in records
            ]
            deviation = math.sqrt(math.fsum(force * force for force in forces) / count)
            if not deviation <= _UNREST * limit:
                raise MmtError(
                    f"{device}: F{name} moves by {deviation:.2g} N while the bias is taken: let "
                    "the tool hang free and at rest, then start again"
                )
        self.bias = mean


def _within(matrix: Matrix, limits: Sequence[float]) -> Six:
    """Return bounds of the raw values within which no part of the wrench exceeds its limit.

    A row of n entries stays within its limit if each product stays within 1/n of the limit. Within
    the bounds no check row by row is needed, as is usual if the device computes the wrench itself.
    """
    bounds = [sys.float_info.max] * 6  # not infinity: an infinite raw value would then pass
    for row, limit in zip(matrix, limits, strict=True):
        entries = [abs(entry) for entry in row]
        share = limit / max(1, sum(entry > 0.0 for entry in entries))
        bounds = [
            min(bound, share / entry) if entry > 0.0 else bound
            for bound, entry in zip(bounds, entries, strict=True)
        ]
    return six_of(bounds)
