"""The samples of a radial basis function network, those that coincide put together."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError

COINCIDENT: Final = 1e-6
"""Largest difference of a normalised coordinate between samples of one centre."""

LARGEST_COORDINATE: Final = 4.0
"""Normalised coordinates are one at the largest speed and force; a boundary lies little beyond."""

LARGEST_VALUE: Final = 1e100


class SampleTable:
    """Samples by handle, and the centres that they make up.

    Parameters
    ----------
    points, values
        Shapes (n, d) and (n, m); they get the handles 0 ... n-1.

    Raises
    ------
    InputError
        There is no sample, shapes disagree, or a number is out of its range.
    """

    def __init__(self, points: FloatArray, values: FloatArray) -> None:
        points, values = np.asarray(points, float), np.asarray(values, float)
        if points.ndim != 2 or values.ndim != 2 or not len(points) == len(values) > 0:
            raise InputError(
                f"points have shape {points.shape} and values {values.shape}: at least one "
                "sample, (n, d) and (n, m)"
            )
        room = len(points) + len(points) // 2 + 16
        self._points = np.empty((room, points.shape[1]))
        self._values = np.empty((room, values.shape[1]))
        self._counts = np.zeros(room)
        self.handles: list[list[int]] = []
        self._samples: dict[int, FloatArray] = {}
        self._centres: dict[int, int] = {}
        self._next = 0
        for point, value in zip(points, values, strict=True):
            self.add(point, value)

    def __len__(self) -> int:
        """Return the number of centres."""
        return len(self.handles)

    @property
    def points(self) -> FloatArray:
        """Points of the centres, shape (c, d): where the first sample of each is."""
        return self._points[: len(self)]

    @property
    def values(self) -> FloatArray:
        """Means of the samples of each centre, shape (c, m)."""
        return self._values[: len(self)]

    @property
    def counts(self) -> FloatArray:
        """Samples of each centre, shape (c,)."""
        return self._counts[: len(self)]

    def centre_of(self, handle: int) -> int:
        """Return the row of a sample's centre; raises `InputError` where there is none."""
        if handle not in self._centres:
            raise InputError(f"sample {handle} is not in the network")
        return self._centres[handle]

    def add(self, point: FloatArray, values: FloatArray) -> tuple[int, int]:
        """Add a sample; return its handle and the row of its centre."""
        point, values = np.asarray(point, float), np.asarray(values, float)
        self._check(point, values)
        handle, self._next = self._next, self._next + 1
        near = np.flatnonzero((np.abs(self.points - point) <= COINCIDENT).all(axis=1))
        centre = int(near[0]) if len(near) else len(self)
        if centre == len(self):
            self._make_room()
            self._points[centre] = point
            self.handles.append([])
        self.handles[centre].append(handle)
        self._samples[handle] = values.copy()
        self._centres[handle] = centre
        self._average(centre)
        return handle, centre

    def remove(self, handle: int) -> None:
        """Remove a sample; an empty centre's row is taken by the last centre.

        Raises
        ------
        InputError
            There is no such sample, or it is the only one.
        """
        centre = self.centre_of(handle)
        if len(self._samples) == 1:
            raise InputError("the only sample of a network cannot be removed")
        self.handles[centre].remove(handle)
        del self._samples[handle], self._centres[handle]
        if self.handles[centre]:
            self._average(centre)
            return
        last = len(self) - 1
        for column in (self._points, self._values, self._counts):
            column[centre] = column[last]
        self.handles[centre] = self.handles[last]
        self.handles.pop()
        if centre < last:
            for moved in self.handles[centre]:
                self._centres[moved] = centre

    def replace(self, values: Mapping[int, FloatArray]) -> None:
        """Give samples, by their handles, other values (m,); raises `InputError` as `add` does."""
        rows = [(self.centre_of(handle), handle) for handle in values]
        stacked = np.stack([np.asarray(value, float) for value in values.values()])
        self._check(self._points[0], stacked[0])
        _check_size(stacked)
        for (centre, handle), value in zip(rows, stacked, strict=True):
            self._samples[handle] = value
            if len(self.handles[centre]) == 1:
                self._values[centre] = value
            else:
                self._average(centre)

    def _average(self, centre: int) -> None:
        members = [self._samples[handle] for handle in self.handles[centre]]
        self._values[centre] = np.mean(members, axis=0)
        self._counts[centre] = len(members)

    def _check(self, point: FloatArray, values: FloatArray) -> None:
        if point.shape != self._points.shape[1:] or values.shape != self._values.shape[1:]:
            raise InputError(
                f"a sample has {point.shape} coordinates and {values.shape} values, not "
                f"{self._points.shape[1:]} and {self._values.shape[1:]} as the network"
            )
        if not (np.abs(point) <= LARGEST_COORDINATE).all():
            raise InputError(
                f"point {point.tolist()}: normalised coordinates are {LARGEST_COORDINATE:g} at most"
            )
        _check_size(values)

    def _make_room(self) -> None:
        if len(self) == len(self._points):
            more = len(self) // 2 + 16
            self._points = np.pad(self._points, ((0, more), (0, 0)))
            self._values = np.pad(self._values, ((0, more), (0, 0)))
            self._counts = np.pad(self._counts, (0, more))


def _check_size(values: FloatArray) -> None:
    if not (np.abs(values) <= LARGEST_VALUE).all():
        raise InputError(f"values must be finite and at most {LARGEST_VALUE:g}")
