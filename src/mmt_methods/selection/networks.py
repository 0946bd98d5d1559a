"""Leave-one-out prediction by a radial basis function network.

The error of a network at a sample, with that sample left out, follows in closed form
(`mmt.texture.interpolation.networks.solving`). If a sample is removed or added for good, the
network is solved anew.
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
        Mask (n,) of the points in the network, at least one.
    smoothing
        Smoothing of the network; 0 passes through every point.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        present: BoolArray,
        smoothing: float = 0.0,
    ) -> None:
        self._points, self._values, self._smoothing = points, values, smoothing
        self._use(np.flatnonzero(present))

    def predict(self, index: int) -> FloatArray | None:
        """Predict the values (v,) at a point without it; None if the others do not suffice."""
        found = np.flatnonzero(self._numbers == index)
        if not len(found):
            return np.asarray(self._network.at(self._points[index : index + 1])[0])
        row = int(found[0])
        pivot = float(self._network.inverse[row, row])
        if self._network.is_indispensable(pivot):
            return None
        return np.asarray(self._values[index] - self._network.weights[row] / pivot)

    def remove(self, index: int) -> None:
        """Remove a point."""
        self._use(self._numbers[self._numbers != index])

    def add(self, index: int) -> None:
        """Add a point."""
        self._use(np.append(self._numbers, index))

    def _use(self, numbers: IntArray) -> None:
        """Solve for the network of some points, at least one."""
        self._numbers = numbers
        self._network = RadialBasisNetwork(
            self._points[numbers], self._values[numbers], self._smoothing
        )
