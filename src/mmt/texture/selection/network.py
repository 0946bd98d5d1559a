"""Leaving samples out of a radial basis function network without solving it again."""

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt.texture.selection.leave_one_out import Interpolator


class NetworkNeighbours:
    """A radial basis function network of fixed kernel, degree and smoothing.

    The value at a sample's place without it follows from the one solution with it, ``y_i -
    w_i / (A^-1)_ii`` (see `RadialBasisSystem.leave_one_out`). Solved once in O(n^3); a sample
    leaves or joins in O(n^2), and after that all questions about present samples together cost
    O(n m) for m values. Of samples at one place, one is taken out and put back, O(n^2).

    Parameters
    ----------
    points
        Shape (n, d), normalised.
    values
        Shape (n, m).
    present
        Shape (n,): which are in the network; at least one.
    settings
        Kernel, degree and smoothing.

    Raises
    ------
    InputError
        See `RadialBasisSystem`.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        present: BoolArray,
        settings: RadialBasisSettings | None = None,
    ) -> None:
        self._points = np.asarray(points, dtype=np.float64)
        self._values = np.asarray(values, dtype=np.float64)
        numbers = np.flatnonzero(present)
        self._system = RadialBasisSystem(self._points[numbers], self._values[numbers], settings)
        self._handles = {index: handle for handle, index in enumerate(numbers.tolist())}
        self._errors: dict[int, FloatArray] | None = None

    def predict(self, index: int) -> FloatArray | None:
        """See `Neighbours`; None also for one without which some polynomial is not told."""
        handle = self._handles.get(index)
        if handle is None:
            return self._at(index)
        if self._errors is None:
            rows = zip(self._system.handles, self._system.leave_one_out(), strict=True)
            self._errors = {sharing[0]: error for sharing, error in rows if len(sharing) == 1}
        if handle not in self._errors:
            self.remove(index)
            value = self._at(index)
            self.add(index)
            return value
        error = self._errors[handle]
        return self._values[index] - error if np.isfinite(error).all() else None

    def remove(self, index: int) -> None:
        """See `Neighbours`."""
        self._system.remove(self._handles.pop(index))
        self._errors = None

    def add(self, index: int) -> None:
        """See `Neighbours`."""
        self._handles[index] = self._system.add(self._points[index], self._values[index])
        self._errors = None

    def _at(self, index: int) -> FloatArray:
        value: FloatArray = self._system.network().at(self._points[index : index + 1])[0]
        return value


def network(settings: RadialBasisSettings | None = None) -> Interpolator:
    """Return an interpolator for `select_published`; see `NetworkNeighbours`."""
    return lambda points, values, present: NetworkNeighbours(points, values, present, settings)
