"""Kernels on qd arrays: the array from nodes and masses.

The array ``q[0], e[0], q[1], e[1], ...`` of positive numbers is the matrix ``B B^T``, B
bidiagonal with the square roots of `q` on the diagonal and of `e` beside it (Rutishauser
1954; Fernando and Parlett, "Accurate singular values and differential qd algorithms", Numer.
Math. 67 (1994), 191-229). Nothing is subtracted, so that every result is accurate relative to
itself. Cost: O(size) a node.
"""

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel


@kernel("void(f8[::1], f8[::1], i8, f8)")
def move_origin(q: FloatArray, e: FloatArray, size: int, distance: float) -> None:
    """Move all nodes up by `distance`: the stationary qd step with a positive shift."""
    t = distance
    for i in range(size):
        old = q[i]
        q[i] = old + t
        if i + 1 < size:
            share = e[i] / q[i]
            e[i] = share * old
            t = distance + share * t


@kernel("void(f8[::1], f8[::1], i8, f8, f8)")
def add_mass(q: FloatArray, e: FloatArray, size: int, mass: float, added: float) -> None:
    """Add a node of mass `added` at zero to nodes of total `mass`; the size grows by one."""
    d = q[0] * (added / (mass + added))
    q[0] *= mass / (mass + added)
    for i in range(size - 1):
        beside = d + e[i]
        following = q[i + 1] / beside
        q[i + 1] = following * e[i]
        d *= following
        e[i] = beside
    e[size - 1] = d
    q[size] = 0.0
