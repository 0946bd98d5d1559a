"""Cholesky factors, triangular systems, and products of small matrices.

A threaded linear algebra library splits matrices of some 64 rows or more among its threads, and
waits for all of them. While other processors are busy, as on a teleoperation machine, a factor
that takes 0.1 ms in one thread has taken 500 ms in two. The number of threads is the program's
choice, not that of `mmt`, so this module computes what modelling repeats in every update.

The algorithms are those of LAPACK's ``potrf`` and ``trtrs`` (Golub and Van Loan, Matrix
Computations, 2013, sections 3.1 and 4.2.6), in blocks of `_BLOCK` rows: the rows of a block stay
in the processor's nearest cache while they are subtracted from all others.

A call releases the interpreter lock for its whole computation. Code that releases the lock often
and briefly (trees of scipy, sorting by numpy) starves other threads: a waiting thread wakes up each
time, finds the lock taken again, and a 1 kHz tick is 1 to 5 ms late.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel

_BLOCK: Final = 8
_INDEFINITE: Final = "the matrix is not positive definite"
_1, _2, _3, _4 = (np.uint64(step) for step in range(1, 5))


def cholesky(matrix: FloatArray) -> FloatArray:
    """Return the Cholesky factor of a symmetric, positive definite matrix (n, n).

    Only the upper triangle is read. The result has U with ``U.T @ U = matrix`` in its upper
    triangle and mirrors it in the lower one, as `solve_forward` and `solve_backward` need.

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is not positive definite, or holds a number that is not finite.
    """
    factor = np.array(matrix, np.float64, order="C")
    if not factorise(factor):
        raise np.linalg.LinAlgError(_INDEFINITE)
    return factor


def solve_forward(factor: FloatArray, rows: FloatArray) -> FloatArray:
    """Return ``x`` with ``x @ U = rows``, each row whitened: ``U.T @ x[i] = rows[i]``.

    Parameters
    ----------
    factor
        Result of `cholesky`, shape (n, n).
    rows
        Right-hand sides, shape (n,) or (m, n).
    """
    solved = np.array(np.atleast_2d(rows), np.float64, order="C")
    forward(factor, solved, False)
    return solved.reshape(np.shape(rows))


def log_evidence(priors: FloatArray, errors: FloatArray, rest: FloatArray) -> FloatArray:
    """Return the log probability density (s,) of observations, up to a constant.

    Parameters
    ----------
    priors, errors, rest
        See `condition`.

    Raises
    ------
    numpy.linalg.LinAlgError
        A matrix of `condition` is not positive definite.
    """
    evidence, nothing = np.empty(len(priors)), np.empty((len(priors), 0))
    if not condition(priors, errors, rest, False, evidence, nothing, nothing):
        raise np.linalg.LinAlgError(_INDEFINITE)
    return evidence


def solve_backward(factor: FloatArray, rows: FloatArray) -> FloatArray:
    """Return ``x`` with ``x @ U.T = rows``, each row ``U @ x[i] = rows[i]``; see `solve_forward`.

    After `solve_forward`, it gives the solution of ``matrix @ x[i] = rows[i]``.
    """
    solved = np.array(np.atleast_2d(rows), np.float64, order="C")
    backward(factor, solved)
    return solved.reshape(np.shape(rows))


@kernel("void(f8[:, ::1], u8, u8, u8, f8[:, ::1], f8[:, ::1], u8)", inner=True)
def _subtract_pair(
    out: FloatArray,
    row: int,
    column: int,
    stop: int,
    weights: FloatArray,
    rows: FloatArray,
    first: int,
) -> None:
    """Do as `_subtract` for two rows of `out` and a whole block, which is read once for both.

    Indices are unsigned: signed ones would be tested for negative values, which prevents
    vectorisation of the loop.
    """
    below = row + _1
    s, t, u, v = weights[row, 0], weights[row, 1], weights[row, 2], weights[row, 3]
    w, x, y, z = weights[row, 4], weights[row, 5], weights[row, 6], weights[row, 7]
    i, k, m, n = weights[below, 0], weights[below, 1], weights[below, 2], weights[below, 3]
    p, q, r, o = weights[below, 4], weights[below, 5], weights[below, 6], weights[below, 7]
    a, b, c, d = first, first + _1, first + _2, first + _3
    e, f, g, h = a + _4, b + _4, c + _4, d + _4
    for j in range(column, stop):
        at_a, at_b, at_c, at_d = rows[a, j], rows[b, j], rows[c, j], rows[d, j]
        at_e, at_f, at_g, at_h = rows[e, j], rows[f, j], rows[g, j], rows[h, j]
        out[row, j] -= ((s * at_a + t * at_b) + (u * at_c + v * at_d)) + (
            (w * at_e + x * at_f) + (y * at_g + z * at_h)
        )
        out[below, j] -= ((i * at_a + k * at_b) + (m * at_c + n * at_d)) + (
            (p * at_e + q * at_f) + (r * at_g + o * at_h)
        )


@kernel("void(f8[:, ::1], u8, u8, u8, f8[:, ::1], u8, f8[:, ::1], u8)", inner=True)
def _subtract_from_row(
    out: FloatArray,
    row: int,
    column: int,
    stop: int,
    weights: FloatArray,
    count: int,
    rows: FloatArray,
    first: int,
) -> None:
    """Do as `_subtract` for one row of `out`."""
    if count == _BLOCK:
        s, t, u, v = weights[row, 0], weights[row, 1], weights[row, 2], weights[row, 3]
        w, x, y, z = weights[row, 4], weights[row, 5], weights[row, 6], weights[row, 7]
        a, b, c, d = first, first + _1, first + _2, first + _3
        e, f, g, h = a + _4, b + _4, c + _4, d + _4
        for j in range(column, stop):  # in one loop, so that out is read and written once
            out[row, j] -= (
                (s * rows[a, j] + t * rows[b, j]) + (u * rows[c, j] + v * rows[d, j])
            ) + ((w * rows[e, j] + x * rows[f, j]) + (y * rows[g, j] + z * rows[h, j]))
        return
    for each in range(count):
        weight = weights[row, each]
        for j in range(column, stop):
            out[row, j] -= weight * rows[first + each, j]


@kernel("void(f8[:, ::1], i8, i8, i8, i8, f8[:, ::1], i8, f8[:, ::1], i8)", inner=True)
def _subtract(
    out: FloatArray,
    row: int,
    last: int,
    column: int,
    stop: int,
    weights: FloatArray,
    count: int,
    rows: FloatArray,
    first: int,
) -> None:
    """Subtract `count` weighted rows, from `first` on, from rows of `out`, between two columns.

    ``weights`` has a row for each row of `out`.
    """
    paired = (last - row) // 2 * 2 if count == _BLOCK else 0
    for each in range(row, row + paired, 2):
        _subtract_pair(out, each, column, stop, weights, rows, first)
    for each in range(row + paired, last):
        _subtract_from_row(out, each, column, stop, weights, count, rows, first)


@kernel("b1(f8[:, ::1])")
def factorise(matrix: FloatArray) -> bool:
    """Overwrite a matrix by its factor; return whether it is positive definite."""
    size = len(matrix)
    weights = np.empty((size, _BLOCK))
    for begin in range(0, size, _BLOCK):
        stop = min(begin + _BLOCK, size)
        for k in range(begin, size):
            for row in range(begin, min(k, stop)):
                weights[k, row - begin] = matrix[row, k]
            if k >= stop:
                continue
            _subtract_from_row(matrix, k, k, size, weights, k - begin, matrix, begin)
            out = matrix[k, k:]
            if not 0.0 < out[0] < np.inf:
                return False
            root = np.sqrt(out[0])
            for j in range(len(out)):
                out[j] /= root
        for k in range(stop, size - 1, 2):  # of the second row, one column more than is needed
            _subtract_pair(matrix, k, k, size, weights, matrix, begin)
        if (size - stop) % 2:
            _subtract_from_row(matrix, size - 1, size - 1, size, weights, _BLOCK, matrix, begin)
    for i in range(size):
        for j in range(i):
            matrix[i, j] = matrix[j, i]
    return True


@kernel("void(f8[:, ::1], f8[:, ::1], b1)")
def forward(factor: FloatArray, rows: FloatArray, upper: bool) -> None:
    """Solve for rows in place; with ``upper``, row i is zero before column i."""
    size = len(factor)
    weights = np.empty((len(rows), _BLOCK))
    for begin in range(0, size, _BLOCK):
        stop = min(begin + _BLOCK, size)
        last = stop if upper else len(rows)
        corner = factor[begin:stop, begin:stop].copy()
        for each in range(last):
            row = rows[each, begin:stop]
            for k in range(stop - begin):
                value, own = row[k], corner[k]
                for j in range(k):
                    value -= own[j] * row[j]
                row[k] = weights[each, k] = value / own[k]
        _subtract(rows, 0, last, stop, size, weights, stop - begin, factor, begin)


@kernel("void(f8[:, ::1], f8[:, ::1])")
def backward(factor: FloatArray, rows: FloatArray) -> None:
    """Solve for rows in place, see `solve_backward`."""
    size = len(factor)
    weights = np.empty((len(rows), _BLOCK))
    for stop in range(size, 0, -_BLOCK):
        begin = max(stop - _BLOCK, 0)
        for each in range(len(rows)):
            row = rows[each]
            for k in range(stop - 1, begin - 1, -1):
                value = row[k]
                for j in range(k + 1, stop):
                    value -= factor[k, j] * row[j]
                row[k] = weights[each, k - begin] = value / factor[k, k]
        _subtract(rows, 0, len(rows), 0, begin, weights, stop - begin, factor, begin)


@kernel("f8[:, ::1](f8[:, :], f8[:, ::1])")
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the matrix product of (n, k) and (k, m)."""
    out, weights = np.zeros((len(a), b.shape[1])), np.empty((len(a), _BLOCK))
    for begin in range(0, len(b), _BLOCK):
        count = min(_BLOCK, len(b) - begin)
        for i in range(len(a)):
            for row in range(count):
                weights[i, row] = -a[i, begin + row]
        _subtract(out, 0, len(a), 0, out.shape[1], weights, count, b, begin)
    return out


@kernel("b1(f8[:, :, ::1], f8[::1], f8[::1], b1, f8[::1], f8[:, ::1], f8[:, ::1])")
def condition(
    priors: FloatArray,
    errors: FloatArray,
    rest: FloatArray,
    left_out: bool,
    evidence: FloatArray,
    gains: FloatArray,
    precision: FloatArray,
) -> bool:
    """Condition each of s normal distributions on the same observations y.

    Uses ``C = prior + diag(errors)`` of each. Returns whether every C is positive definite.

    Parameters
    ----------
    priors : (s, n, n)
        Prior covariances of the observed values; only upper triangles are read.
    errors : (n,)
        Variances of the observations' errors, positive.
    rest : (n,)
        Observations y, minus their prior mean.
    left_out
        Whether to compute `gains` and `precision`, which predict each observation from the others.
    evidence : (s,)
        Receives the log probability density of y, up to a constant.
    gains, precision : (s, n)
        Receive ``inverse(C) y`` and the diagonal of ``inverse(C)``.
    """
    size = len(rest)
    factor, whitened = np.empty((size, size)), np.empty((1, size))
    root = np.empty((size, size) if left_out else (0, 0))
    for each in range(len(priors)):
        for i in range(size):
            whitened[0, i] = rest[i]
            for j in range(size):
                factor[i, j] = priors[each, i, j]
            factor[i, i] += errors[i]
        if not factorise(factor):
            return False
        forward(factor, whitened, False)
        evidence[each] = 0.0
        for i in range(size):
            evidence[each] -= 0.5 * whitened[0, i] ** 2 + np.log(factor[i, i])
        if not left_out:
            continue
        for i in range(size):
            for j in range(size):
                root[i, j] = 1.0 if i == j else 0.0
        forward(factor, root, True)
        for i in range(size):
            gains[each, i] = precision[each, i] = 0.0
            for j in range(i, size):
                gains[each, i] += root[i, j] * whitened[0, j]
                precision[each, i] += root[i, j] ** 2
    return True
