"""Radial basis networks: samples all but coincident, flat kernels, growth, invalid filters.

The system's condition grows without bound as samples approach each other or functions become
flat. What a network may then not do is leave its samples without saying so: either it goes
through them, or smoothing has been added, which its settings show.
"""

import time
from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection
from mmt.texture.interpolation.radial_basis.evaluation import nearest_valid_lsf
from mmt.texture.interpolation.radial_basis.functions import (
    FUNCTIONS,
    KernelName,
    evaluate_each_into,
)
from mmt.texture.interpolation.radial_basis.network import RadialBasisNetwork, RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt_lab.stability.cases import Case, Family, Outcome

FLAT: Final = (0.001, 0.1, 1.0, 1000.0)
"""Shape parameters: 0.001 is all but constant over the space, 1000 a needle at each sample."""

_GROWTH: Final = "the network solved at once, to the rounding of its weights"
_LEFT_OUT: Final = "the error in closed form is that of the network solved so, to 1e-6"
_THROUGH: Final = "off by its smoothing alone, that under 1e-7; under 10 elsewhere"

LARGEST_SMOOTHING: Final = 1e-7
"""What may be added to the diagonal of a system of functions of about one."""


def cases(*, samples: int = 60, steps: int = 600) -> list[Case]:
    """Return the family's cases.

    Parameters
    ----------
    samples
        Samples of each network.
    steps
        Samples that come and go in the long growth.
    """
    cubic, linear = RadialBasisSettings("cubic", 1), RadialBasisSettings("linear", 0)
    return [
        *(
            Case(f"{samples} samples, {what}", _THROUGH, partial(_through, points, settings))
            for what, points, settings in _difficult(samples)
        ),
        Case(
            f"a network without each of {samples} samples",
            "solved so, to 1e-6",
            partial(_left_out, samples),
        ),
        *(
            Case(f"{samples} samples come, {what}", _GROWTH, partial(_grown, points, settings))
            for what, points, settings in (
                ("anywhere, linear", _anywhere(samples), linear),
                ("anywhere, cubic", _anywhere(samples), cubic),
                ("on a plane, then beside it, cubic", _beside_a_plane(samples), cubic),
                ("each repeated three times, smoothed", _repeated(samples), _smoothed(cubic)),
                ("in pairs 1e-5 apart, cubic", _pairs(samples, 1e-5), cubic),
                ("anywhere, flat gaussian", _anywhere(samples), _gaussian(0.1)),
            )
        ),
        Case(
            f"{steps} samples come and go, {samples} at a time",
            "solved at once to 1e-6, time a step flat within 3 x",
            partial(_window, samples, steps),
        ),
        *(
            Case(
                f"2000 sets of frequencies of order {order}, off by {noise:g} rad",
                "ascending by the least gap, within bounds, |k| < 1",
                partial(_made_valid, order, noise),
            )
            for order, noise in ((1, 10.0), (8, 0.1), (24, 1.0), (64, 1e6))
        ),
    ]


def _difficult(count: int) -> Iterator[tuple[str, FloatArray, RadialBasisSettings]]:
    scale_free: tuple[KernelName, ...] = ("linear", "thin_plate_spline", "cubic")
    shaped: tuple[KernelName, ...] = ("gaussian", "multiquadric", "inverse_multiquadric")
    for apart in (1e-3, 1e-5, 2e-6):
        for name in scale_free:
            pairs = _pairs(count, apart)
            yield f"in pairs {apart:g} apart, {name}", pairs, RadialBasisSettings(name)
    for name in shaped:
        for epsilon in FLAT:
            yield (
                f"{name}, epsilon {epsilon:g}",
                _anywhere(count),
                RadialBasisSettings(name, max(FUNCTIONS[name].least_degree, 0), epsilon),
            )
    line = np.outer(np.linspace(0.05, 0.95, count), (0.6, -0.5, 1.0))
    yield "on a line, cubic of degree 2", line, RadialBasisSettings("cubic", 2)
    plane = _anywhere(count)
    plane[:, 2] = 0.5
    yield "on a plane, quintic of degree 2", plane, RadialBasisSettings("quintic", 2)
    close = 0.4 + 1e-4 * _anywhere(count)
    yield "within 1e-4 of each other, cubic", close, RadialBasisSettings("cubic")


def _anywhere(count: int) -> FloatArray:
    generator = np.random.default_rng(count)
    turn, speed = generator.uniform(0.0, 7.0, count), np.sqrt(generator.uniform(0.0, 1.0, count))
    return np.column_stack([speed * np.cos(turn), speed * np.sin(turn), generator.random(count)])


def _pairs(count: int, apart: float) -> FloatArray:
    centres = _anywhere(count // 2)
    return np.repeat(centres, 2, axis=0) + apart * np.tile([[0.0], [1.0]], (len(centres), 3))


def _repeated(count: int) -> FloatArray:
    return np.tile(_anywhere(count // 3), (3, 1))


def _beside_a_plane(count: int) -> FloatArray:
    points = _anywhere(count)
    points[: count // 2, 2] = 0.5
    return points


def _gaussian(epsilon: float) -> RadialBasisSettings:
    return RadialBasisSettings("gaussian", 0, epsilon)


def _smoothed(settings: RadialBasisSettings) -> RadialBasisSettings:
    return RadialBasisSettings(settings.kernel, settings.degree, settings.epsilon, 0.1)


def _values(points: FloatArray) -> FloatArray:
    """Return a smooth function of points (n, 3), as two outputs (n, 2) within one."""
    one = np.sin(3.0 * points[:, 0]) * np.cos(2.0 * points[:, 1]) * points[:, 2]
    return np.column_stack([one, np.cos(points @ (1.0, -2.0, 1.5))])


def _at(network: RadialBasisNetwork, points: FloatArray) -> FloatArray:
    """Evaluate a network (q, m) anywhere; its own method is for the unit box."""
    values = np.empty((len(points), network.weights.shape[1]))
    evaluate_each_into(
        network.number,
        network.settings.epsilon,
        network.centres,
        network.weights,
        network.exponents,
        network.coefficients,
        np.ascontiguousarray(points),
        values,
    )
    return values


def _through(points: FloatArray, settings: RadialBasisSettings) -> Outcome:
    """Compare what a network is off by with its smoothing times its weights.

    Beside that only rounding is left, in units of the largest weight, which cancels in the sum.
    """
    values = _values(points)
    network = RadialBasisSystem(points, values, settings).network()
    smoothing, weight = network.settings.smoothing, float(np.abs(network.weights).max())
    off = values - _at(network, points)
    unexplained = float(np.abs(off - smoothing * network.weights).max())
    largest = float(np.abs(_at(network, _anywhere(500))).max())
    allowed = max(1e-9, 1e-14 * weight)
    return Outcome(
        f"off by {np.abs(off).max():.0e}, all but {unexplained:.0e} by smoothing of "
        f"{smoothing:.0e}; to {largest:.1f} elsewhere",
        held=unexplained <= allowed < 1e-3 and smoothing <= LARGEST_SMOOTHING and largest < 10.0,
        figures={"off": np.abs(off).max(), "unexplained": unexplained, "smoothing": smoothing},
    )


def _left_out(count: int) -> Outcome:
    """Compare the closed form of the errors with networks that are solved without a sample."""
    points, worst = _anywhere(count), 0.0
    values = _values(points)
    for settings in (RadialBasisSettings("cubic", 1), _smoothed(RadialBasisSettings("linear", 1))):
        errors = RadialBasisSystem(points, values, settings).leave_one_out()
        for index in range(count):
            kept = np.arange(count) != index
            without = RadialBasisSystem(points[kept], values[kept], settings).network()
            solved = values[index] - _at(without, points[index : index + 1])[0]
            worst = max(worst, float(np.abs(solved - errors[index]).max()))
    return Outcome(f"off by {worst:.0e}", held=worst < 1e-6, figures={"off": worst})


def _grown(points: FloatArray, settings: RadialBasisSettings) -> Outcome:
    """Let all but five samples come one after the other, and every third one go again."""
    values = _values(points)
    system = RadialBasisSystem(points[:5], values[:5], settings)
    handles = [
        system.add(point, value) for point, value in zip(points[5:], values[5:], strict=True)
    ]
    for handle in handles[::3]:
        system.remove(handle)
    kept = np.ones(len(points), dtype=np.bool_)
    kept[5::3] = False
    off = _apart(system, points[kept], values[kept])
    return Outcome(
        f"off by {off:.0e}, solved {system.solutions} times in {len(handles) * 4 // 3} steps",
        held=off < max(1e-7, 1e-13 * float(np.abs(system.network().weights).max())),
        figures={"off": off, "solutions": system.solutions},
    )


def _apart(system: RadialBasisSystem, points: FloatArray, values: FloatArray) -> float:
    """Return how far a grown network is from one that is solved at once, over the space.

    With the same smoothing: how much is added depends on what the samples were before.
    """
    grown = system.network()
    anew = RadialBasisSystem(points, values, grown.settings).network()
    asked = _anywhere(500)
    return float(np.abs(_at(grown, asked) - _at(anew, asked)).max())


def _window(count: int, steps: int) -> Outcome:
    """Let every new sample take the place of the oldest, and watch error and time."""
    settings = RadialBasisSettings("thin_plate_spline", 1)
    points = _anywhere(count + steps)
    values = _values(points)
    system = RadialBasisSystem(points[:count], values[:count], settings)
    off, seconds = 0.0, []
    for step in range(steps):
        started = time.thread_time()
        system.add(points[count + step], values[count + step])
        system.remove(step)
        seconds.append(time.thread_time() - started)
        if step % (steps // 10) == 0 or step == steps - 1:
            rows = slice(step + 1, step + 1 + count)
            off = max(off, _apart(system, points[rows], values[rows]))
    parts = [float(np.quantile(part, 0.1)) for part in np.array_split(seconds, 4)]
    ratio = max(parts) / min(parts)
    return Outcome(
        f"off by {off:.0e}, solved {system.solutions} times, {1e6 * min(parts):.0f} us a step, "
        f"{ratio:.2f} x",
        held=off < 1e-6 and ratio < 3.0,
        figures={"off": off, "solutions": system.solutions, "flat": ratio},
    )


def _made_valid(order: int, noise: float) -> Outcome:
    """Spoil frequencies as an overshooting network does, by more and more, some to no number."""
    generator = np.random.default_rng(order)
    gap, least, largest_k = min(0.03, 0.5 * np.pi / (order + 1)), np.inf, 0.0
    lowest: FloatArray = gap * np.arange(1.0, order + 1)
    highest: FloatArray = np.ascontiguousarray(np.pi - lowest[::-1])
    within = True
    for _ in range(2000):
        lsf = np.sort(generator.uniform(0.0, np.pi, order)) + noise * generator.normal(size=order)
        lsf[generator.random(order) < 0.02] = generator.choice([np.nan, np.inf, -np.inf])
        nearest_valid_lsf(lsf, gap, lowest, highest, np.empty(3 * order))
        least = min(least, float(np.diff(lsf, prepend=0.0, append=np.pi).min()))
        within &= bool((lsf >= lowest - 1e-9).all() and (lsf <= highest + 1e-9).all())
        largest_k = max(largest_k, float(np.abs(lsf_to_reflection(lsf)).max()))
    return Outcome(
        f"gaps from {least:.3g} rad of {gap:.3g}, |k| to 1 - {1.0 - largest_k:.0e}, "
        f"{'within' if within else 'beyond'} bounds",
        held=least >= gap * (1.0 - 1e-9) and largest_k < 1.0 and within,
        figures={"least_gap_rad": least, "largest_k": largest_k},
    )


FAMILY: Final = Family("Radial basis networks", cases)
