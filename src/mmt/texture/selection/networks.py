"""Leave-one-out prediction by a radial basis function network, which is not trained again.

The error of a network at a sample without that sample follows in closed form, and a sample that
leaves for good takes its row and column out of the inverse, ``B - b b^T / b_i``, in O(n^2)
(`mmt.texture.interpolation.networks.solving`). One that comes has the network solved anew.
"""

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray
from mmt.texture.interpolation.networks.solving import RadialBasisNetwork


class NetworkNeighbours:
    """One network for all values, through or near every present point.

    Parameters
    ----------
    points
        Shape (n, d), in the unit box.
    values
        Shape (n, v).
    present
        Shape (n,): which are in the network, at least one.
    smoothing
        Of the network.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        present: BoolArray,
        smoothing: float = 0.0,
    ) -> None:
        self._points, self._values, self._smoothing = points, values, smoothing
        self._numbers: IntArray
        self._network: RadialBasisNetwork
        self._weights: FloatArray
        self._inverse: FloatArray | None
        self._use(np.flatnonzero(present))

    def predict(self, index: int) -> FloatArray | None:
        """Return the values (v,) without the point; None where the others do not suffice."""
        found = np.flatnonzero(self._numbers == index)
        if not len(found):
            if len(self._network.points) != len(self._numbers):
                self._use(self._numbers)
            return np.asarray(self._network.at(self._points[index : index + 1])[0])
        row, inverse = int(found[0]), self._inverted()
        pivot = float(inverse[row, row])
        if self._network.is_indispensable(pivot):
            return None
        return np.asarray(self._values[index] - self._weights[row] / pivot)

    def remove(self, index: int) -> None:
        """Remove a point."""
        row, inverse = int(np.flatnonzero(self._numbers == index)[0]), self._inverted()
        column, pivot = inverse[:, row], float(inverse[row, row])
        self._numbers = np.delete(self._numbers, row)
        if self._network.is_indispensable(pivot):
            self._use(self._numbers)
            return
        weights = self._weights - np.outer(column, self._weights[row] / pivot)
        inverse = inverse - np.outer(column, column / pivot)
        self._weights = np.delete(weights, row, axis=0)
        self._inverse = np.delete(np.delete(inverse, row, axis=0), row, axis=1)

    def add(self, index: int) -> None:
        """Add a point."""
        self._use(np.append(self._numbers, index))

    def _use(self, numbers: IntArray) -> None:
        """Solve for the network of some points, at least one."""
        self._numbers = numbers
        self._network = RadialBasisNetwork(
            self._points[numbers], self._values[numbers], self._smoothing
        )
        self._weights = self._network.weights
        self._inverse = None

    def _inverted(self) -> FloatArray:
        """Return the inverse that gives the weights of the points that are left."""
        if self._inverse is None:
            self._inverse = self._network.inverse
        return self._inverse
