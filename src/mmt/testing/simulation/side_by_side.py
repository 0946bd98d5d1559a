"""Autoregressive filters that run side by side, each on a noise of its own."""

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], i8)")
def filter_side_by_side(
    backward: FloatArray, noise: FloatArray, outputs: FloatArray, start: int
) -> None:
    """Append the next outputs of filters to their last ones; about 0.2 ns for each order.

    Parameters
    ----------
    backward
        Coefficients (order, filters), that of the oldest output first.
    noise
        Input of each filter, (n, filters).
    outputs
        Outputs (m, filters), m at least start + order + n. The `order` rows from `start` on are the
        last ones, and the n rows behind them are written.
    start
        Row of the oldest output that counts.
    """
    order, filters = backward.shape
    for sample in range(len(noise)):
        now = outputs[start + sample + order]
        for place in range(filters):
            now[place] = 0.0
        for lag in range(order):
            coefficients, past = backward[lag], outputs[start + sample + lag]
            for place in range(filters):
                now[place] += coefficients[place] * past[place]
        for place in range(filters):
            now[place] = noise[sample, place] - now[place]
