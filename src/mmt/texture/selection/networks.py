"""Leave-one-out prediction by a radial basis function network, which is not trained again.

A network without one of its centres follows in closed form, and samples come and go at O(n^2); see
`mmt.texture.interpolation.radial_basis.online`.
"""

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.interpolation.radial_basis.network import PUBLISHED
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem


class NetworkNeighbours:
    """One network for all values, through every present point; see `LeaveOneOutModel`.

    Parameters
    ----------
    points
        Shape (n, d), in the unit box.
    values
        Shape (n, v).
    present
        Shape (n,): which are in the network, at least one.
    """

    def __init__(self, points: FloatArray, values: FloatArray, present: BoolArray) -> None:
        self._points, self._values = points, values
        numbers = np.flatnonzero(present)
        self._system = RadialBasisSystem(points[numbers], values[numbers], PUBLISHED)
        self._handles = {number: handle for handle, number in enumerate(numbers.tolist())}

    def predict(self, index: int) -> FloatArray | None:
        """Return the values (v,) without the point; None where the others do not suffice."""
        if index not in self._handles:
            predicted: FloatArray = self._system.network().at(self._points[index : index + 1])[0]
            return predicted
        handle = self._handles[index]
        centre = next(c for c, held in enumerate(self._system.handles) if handle in held)
        if len(self._system.handles[centre]) > 1:  # its place stays a centre of the others
            self.remove(index)
            predicted = self._system.network().at(self._points[index : index + 1])[0]
            self.add(index)
            return predicted
        error = self._system.leave_one_out()[centre]
        return self._values[index] - error if np.isfinite(error).all() else None

    def remove(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._system.remove(self._handles.pop(index))

    def add(self, index: int) -> None:
        """See `LeaveOneOutModel`."""
        self._handles[index] = self._system.add(self._points[index], self._values[index])
