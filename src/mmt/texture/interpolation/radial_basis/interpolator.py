"""A texture model by radial basis function networks, which grows at O(n^2) a sample.

One network gives the line spectral frequencies (LSF) and goes over the samples alone; the
other gives the level and has, besides, the points of the boundary at which it is zero. There a
hand feels nothing, but no filter belongs to them: a copy of the nearest sample's, as
the boundary of a triangulation needs it, would be data that contradicts the samples.

The level is interpolated as it is and clamped, not by its logarithm: a logarithm has no zero,
and a floor in its place is a cliff at which the network rings.

Kernel, degree and smoothing of either network are chosen by leave-one-out error, anew whenever
the number of samples has doubled or halved, which adds O(n^2) to each sample's cost.

`build_published` builds the single network of paper B from the same parts.
"""

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.texture.interpolation.interpolator import Interpolant, State
from mmt.texture.interpolation.radial_basis.choice import choose_settings
from mmt.texture.interpolation.radial_basis.evaluation import Bounds, evaluate_networks, least_gap
from mmt.texture.interpolation.radial_basis.functions import monomials
from mmt.texture.interpolation.radial_basis.network import (
    PUBLISHED,
    RadialBasisNetwork,
    RadialBasisSettings,
)
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt.texture.interpolation.vertices import Vertices

CANDIDATES: Final = (
    RadialBasisSettings("linear", 0),
    RadialBasisSettings("thin_plate_spline", 1),
    RadialBasisSettings("cubic", 1),
)
"""Few: of 20 noisy samples the best of many candidates is the one that fits their noise."""

LEVEL_ROOM: Final = 2.0
"""Largest level over the samples' largest: the level goes on rising beyond the fastest and
strongest of them, and an extrapolation gone wild is held."""

LEAST_REACH: Final = 0.01
"""Normalised speed and force from which on the level falls to zero, whatever the samples."""

_LARGEST_LEVEL: Final = 2.0**10  # in units of the first samples' largest

_STATE: Final = ("network_kernel", "network_degree", "network_epsilon", "network_smoothing")
"""Arrays of a model file, in the order of `RadialBasisSettings`."""

Row = bytes
"""A point and its filter, as a key."""


class Networks(NamedTuple):
    """Settings of both networks, which a model file stores."""

    level: RadialBasisSettings
    filters: RadialBasisSettings

    def state(self) -> State:
        """Return them as the arrays of a model file, each of shape (2,)."""
        rows = [(n.kernel, n.highest_degree, n.epsilon, n.smoothing) for n in self]
        return dict(zip(_STATE, map(np.array, zip(*rows, strict=True)), strict=True))


def networks_from(state: State) -> Networks:
    """Return what `Networks.state` returned.

    Raises
    ------
    InputError
        An array is missing, or is not what a network can have.
    """
    for name in _STATE:
        if name not in state:
            raise InputError(f"the array {name!r} is missing")
    columns = [state[name] for name in _STATE]
    if any(column.shape != (2,) for column in columns) or columns[1].dtype.kind != "i":
        raise InputError("its networks are not two, or their degrees no integers")
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return Networks(*(RadialBasisSettings(*row) for row in rows))


@dataclass(frozen=True, eq=False, kw_only=True)
class RadialBasisInterpolant(Interpolant):
    """An interpolant that remembers the systems it came from, at a state of theirs.

    ``level`` and ``filters`` are the networks, the level's in units of its own; ``changes`` is
    how often the systems had changed.
    """

    level: RadialBasisNetwork
    filters: RadialBasisNetwork
    growth: "_Growth" = field(repr=False)
    changes: int = field(repr=False)

    def state(self) -> State:
        """Return the settings of level and filters."""
        return Networks(self.level.settings, self.filters.settings).state()


def build(
    vertices: Vertices, previous: Interpolant | None, state: State | None
) -> RadialBasisInterpolant:
    """Build the networks of samples with level and LSF.

    At boundary points without vibration the level is zero; others are not used. The systems of
    `previous` go on where they have not grown elsewhere since; where many of the samples are new
    or gone, they are solved anew. Costs O(n^2) for every sample more or less, or O(n^3). With the
    settings of level and filters in `state` they are not chosen, which is most of what solving
    anew costs.
    """
    is_silent = vertices.values[:, 0] == 0.0
    is_silent[: vertices.samples] = False
    silent = vertices.points[is_silent]
    networks = None if state is None else networks_from(state)
    return _build(vertices, silent, previous, networks, falls=len(silent) > 0)


def build_published(
    vertices: Vertices, previous: Interpolant | None, state: State | None
) -> RadialBasisInterpolant:
    """Build the network of paper B: level and LSF alike, through the samples and nothing else.

    Two networks of the same settings over the same samples are one. What its equation leaves open
    is as in `build`: outputs are made a valid filter, and the level falls to zero at rest. Costs as
    `build`, without a choice of settings.
    """
    networks = Networks(PUBLISHED, PUBLISHED) if state is None else networks_from(state)
    return _build(vertices, vertices.points[:0], previous, networks, falls=True)


def _build(
    vertices: Vertices,
    silent: FloatArray,
    previous: Interpolant | None,
    networks: Networks | None,
    *,
    falls: bool,
) -> RadialBasisInterpolant:
    """Let the systems of `previous` go on, or solve them anew.

    Parameters
    ----------
    silent
        Where the level is zero, shape (k, d).
    networks
        Settings; None chooses them.
    falls
        Whether the level's bound falls to zero from the slowest and the lightest sample on.
    """
    points = vertices.points[: vertices.samples]
    values = vertices.values[: vertices.samples]
    growth = previous.growth if isinstance(previous, RadialBasisInterpolant) else None
    if (
        growth is None
        or growth.changes != getattr(previous, "changes", None)
        or not np.array_equal(growth.silent, silent)
        or not growth.follow(points, values)
    ):
        growth = _Growth(points, values, silent, networks, falls=falls)
    return growth.interpolant(points, values)


class _Growth:
    """The systems of level and filters over the same samples."""

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        silent: FloatArray,
        networks: Networks | None,
        *,
        falls: bool,
    ) -> None:
        self.silent = silent
        self._falls = falls
        largest = float(values[:, 0].max())
        self._unit = 2.0 ** float(np.floor(np.log2(largest))) if largest > 0.0 else 1.0
        self._chosen_at = len(points)
        self.changes = 0
        around = np.vstack([points, silent])
        levels = np.vstack([values[:, :1] / self._unit, np.zeros((len(silent), 1))])
        filters = values[:, 1:]
        of_level, of_filters = networks or (_chosen(around, levels), _chosen(points, filters))
        self._level = RadialBasisSystem(around, levels, of_level)
        self._filters = RadialBasisSystem(points, filters, of_filters)
        handles = enumerate(_rows(points, filters))
        self._handles = {row: (index, index) for index, row in handles}
        self._levels = dict(zip(self._handles, values[:, 0] / self._unit, strict=True))

    def follow(self, points: FloatArray, values: FloatArray) -> bool:
        """Let samples come and go; say whether that is better than to begin anew.

        Samples are known by their points and filters; the levels may all have changed.
        """
        rows = _rows(points, values[:, 1:])
        gone, new = self._handles.keys() - set(rows), set(rows) - self._handles.keys()
        largest = float(values[:, 0].max()) / self._unit
        if (
            not self._chosen_at / 2 < len(points) < 2 * self._chosen_at
            or len(gone) + len(new) > len(points) // 4
            or not (largest == 0.0 or 1.0 / _LARGEST_LEVEL < largest < _LARGEST_LEVEL)
        ):
            return False
        self.changes += 1
        levels = dict(zip(rows, values[:, 0] / self._unit, strict=True))
        for row in rows:
            if row in new:
                point, filters = np.split(np.frombuffer(row), [points.shape[1]])
                level_handle = self._level.add(point, levels[row][None])
                self._handles[row] = level_handle, self._filters.add(point, filters)
                self._levels[row] = levels[row]
        for row in gone:
            level_handle, filters_handle = self._handles.pop(row)
            self._level.remove(level_handle)
            self._filters.remove(filters_handle)
            del self._levels[row]
        if self._levels != levels:
            self._level.replace({self._handles[row][0]: levels[row][None] for row in rows})
            self._levels = levels
        return True

    def interpolant(self, points: FloatArray, values: FloatArray) -> RadialBasisInterpolant:
        """Return both networks as they are, with the bounds of these samples."""
        level, filters = self._level.network(), self._filters.network()
        speed = points[:, 0] if points.shape[1] == 2 else np.hypot(points[:, 0], points[:, 1])
        slowest, lightest = (max(float(x.min()), LEAST_REACH) for x in (speed, points[:, -1]))
        bounds = Bounds(
            level.settings.epsilon**2,
            filters.settings.epsilon**2,
            least_gap(values[:, 1:]),
            self._unit,
            slowest if self._falls else 0.0,
            lightest if self._falls else 0.0,
        )
        limits = values.min(axis=0), values.max(axis=0)
        limits[1][0] *= LEVEL_ROOM
        rows, links, tail = _packed(level, filters, bounds, limits)
        return RadialBasisInterpolant(
            evaluator=evaluate_networks,
            rows=rows,
            links=links,
            tail=tail,
            level=level,
            filters=filters,
            growth=self,
            changes=self.changes,
        )


def _rows(points: FloatArray, filters: FloatArray) -> list[Row]:
    return [row.tobytes() for row in np.hstack([points, filters])]


def _chosen(points: FloatArray, values: FloatArray) -> RadialBasisSettings:
    """Return the settings of least error; of too few samples to tell, the calmest."""
    trial = choose_settings(points, values, np.ones(values.shape[1]), CANDIDATES)
    return trial.settings if np.isfinite(trial.error) else CANDIDATES[0]


def _packed(
    level: RadialBasisNetwork,
    filters: RadialBasisNetwork,
    bounds: Bounds,
    limits: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the arrays that `mmt.texture.interpolation.radial_basis.evaluation` takes.

    A centre of both networks has one row; the rows of filters come first.
    """
    order = filters.weights.shape[1]
    samples, dimensions = filters.centres.shape
    numbers = {centre.tobytes(): number for number, centre in enumerate(level.centres)}
    shared = np.array([numbers.get(centre.tobytes(), -1) for centre in filters.centres])
    others = np.setdiff1d(np.arange(len(level.centres)), shared)
    rows = np.zeros((samples + len(others), dimensions + 1 + order))
    rows[:samples, :dimensions] = filters.centres
    rows[:samples, dimensions] = np.where(shared >= 0, level.weights[shared, 0], 0.0)
    rows[:samples, dimensions + 1 :] = filters.weights
    rows[samples:, : dimensions + 1] = np.hstack([level.centres, level.weights])[others]
    degree = max(int(network.exponents.sum(axis=1).max()) for network in (level, filters))
    exponents = monomials(dimensions, degree)
    links = np.zeros((1 + len(exponents), 3), dtype=np.int64)
    links[0] = samples, level.number, filters.number
    links[1:, :dimensions] = exponents
    tail = np.zeros((3 + len(exponents), max(len(bounds), 1 + order)))
    tail[0, : len(bounds)] = bounds
    tail[1:3, : 1 + order] = limits
    tail[3 : 3 + len(level.coefficients), 0] = level.coefficients[:, 0]
    tail[3 : 3 + len(filters.coefficients), 1 : 1 + order] = filters.coefficients
    return rows, links, tail
