"""Burg's method beside its peers: time, accuracy, and stability on stiff signals."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import burg, burg_batch
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt_lab.bench import peers, references, signals
from mmt_lab.bench.measuring import interleave
from mmt_lab.harness.findings import (
    MICROSECONDS,
    TIME_US,
    Axis,
    Curve,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    Spread,
    Target,
)

SHOWS: Final = (
    "what Burg's method costs and how exact it is beside its peers, also where it is stiff"
)
TAKES: Final = "2 min"
GROUP: Final = "bench"

OURS: Final = "mmt"
OFFSET_ORDER: Final = 10
ERROR: Final = Axis("error of the coefficients over the largest", "error")

Fit = Callable[[FloatArray, int], FloatArray]
"""From a segment (n,) and an order to filter coefficients (order,)."""


@dataclass(frozen=True)
class BurgFit:
    """One implementation: the call for its result, and the calls timed for a segment and a batch.

    ``fit_alone`` is None if it is ``coefficients``. ``fit_batch`` is None if the package has no
    call for a batch: then the time is that of a call for one segment.
    """

    name: str
    coefficients: Fit
    fit_alone: Callable[[FloatArray, int], object] | None = None
    fit_batch: Callable[[FloatArray, int], object] | None = None

    @property
    def fit(self) -> Callable[[FloatArray, int], object]:
        """The call that is timed for one segment."""
        return self.fit_alone or self.coefficients


ORDERS: Final = (8, 10, 16, 24, 40)
LENGTH: Final = 200
BATCH: Final = (50, 1000)
ROUNDS: Final = 15
OFFSETS: Final = (1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
STIFF: Final = signals.STIFF_CASES


@peers.quiet()
def run() -> Findings:
    """Measure every implementation that is installed."""
    modules, left_out = peers.find(("librosa", "memspectrum", "spectrum", "statsmodels"))
    methods = [BurgFit(OURS, _ours, burg, burg_batch), *_peers(modules)]
    single = _by_order(methods)
    batch = _by_batch(methods)
    stiff = _stiff(methods)
    return Findings(
        title="Burg's method",
        about=(
            "Each package's own call on one segment, and on a batch (in one call where the "
            "package has one, else one call after the other). mmt and spectrum return "
            "reflection coefficients, the others filter coefficients; errors are of filter "
            f"coefficients, against Burg's method with {references.DIGITS} digits on the same "
            "samples, relative to the largest. A stiff case is held where the reflection "
            "coefficients that a method returns, or those that belong to exactly the filter "
            "coefficients that it returns, are below one in magnitude; residual is the "
            "prediction error that the filter leaves over what the reference leaves."
        ),
        panels=(single, batch, _by_offset(methods)),
        records=(stiff,),
        targets=(_speed_target(single, 4.0), _speed_target(batch, 2.0), *_stiff_targets(stiff)),
        left_out=left_out,
    )


def _ours(x: FloatArray, order: int) -> FloatArray:
    return reflection_to_ar(burg(x, order).reflection)


def _peers(modules: Mapping[str, Any]) -> Iterator[BurgFit]:
    """Yield the installed peers, each called as in its own documentation."""
    if librosa := modules.get("librosa"):
        yield BurgFit(
            "librosa",
            lambda x, order: librosa.lpc(x, order=order)[1:],
            fit_batch=lambda rows, order: librosa.lpc(rows, order=order),
        )
    if memspectrum := modules.get("memspectrum"):
        for kind in ("standard", "Fast"):
            yield BurgFit(f"memspectrum, {kind}", partial(_memspectrum, memspectrum, kind))
    if spectrum := modules.get("spectrum"):
        yield BurgFit("spectrum", lambda x, order: spectrum.arburg(x, order)[0].real)
    if statsmodels := modules.get("statsmodels"):
        yield BurgFit("statsmodels", lambda x, order: -statsmodels.burg(x, order, demean=False)[0])


def _memspectrum(module: Any, kind: str, x: FloatArray, order: int) -> FloatArray:
    solver = module.MESA()
    solver.solve(x, m=order + 1, optimisation_method="Fixed", method=kind)
    return np.asarray(solver.a_k[1:], dtype=np.float64)


def _by_order(methods: Sequence[BurgFit]) -> Panel:
    x = signals.texture(LENGTH, seed=1)
    times = {
        order: interleave({m.name: partial(m.fit, x, order) for m in methods}, ROUNDS)
        for order in ORDERS
    }
    curves = _curves(methods, times, x)
    title = f"One segment of {LENGTH} samples, by order"
    return Panel("order", title, "order", TIME_US, ERROR, curves)


def _by_batch(methods: Sequence[BurgFit]) -> Panel:
    count, length = BATCH
    rows = np.array([signals.texture(length, seed=seed) for seed in range(count)])
    times = {}
    for order in ORDERS:
        calls = {
            m.name: partial(m.fit_batch, rows, order)
            if m.fit_batch
            else partial(m.fit, rows[0], order)
            for m in methods
        }
        spent = interleave(calls, ROUNDS)
        times[order] = {
            m.name: spent[m.name].times(1.0 / count if m.fit_batch else 1.0) for m in methods
        }
    curves = _curves(methods, times, rows[0])
    title = f"Batches of {count} segments of {length} samples, time of one segment, by order"
    return Panel("batch", title, "order", TIME_US, ERROR, curves)


def _by_offset(methods: Sequence[BurgFit]) -> Panel:
    """Return the errors on white noise with an offset; nothing is timed."""
    curves = Curves()
    for offset in OFFSETS:
        x = signals.offset_noise(offset)
        expected = references.step_up(references.burg(x, OFFSET_ORDER))
        for method in methods:
            try:
                error = _error(method.coefficients(x, OFFSET_ORDER), expected)
                curves.add(method.name, offset, offset, error)
            except peers.FAILURES as failure:
                curves.fail(method.name, offset, str(failure))
    knob = "offset over the noise"
    title = f"White noise on an offset, order {OFFSET_ORDER}, by the {knob}"
    return Panel("offset", title, knob, Axis(knob, "offset"), ERROR, curves.build())


def _error(found: FloatArray, expected: Sequence[Any]) -> float:
    largest = max(1.0, *(float(abs(value)) for value in expected))
    return references.largest_error(found, expected) / largest


def _curves(
    methods: Sequence[BurgFit], times: Mapping[int, Mapping[str, Spread]], x: FloatArray
) -> tuple[Curve, ...]:
    """Return the times of the methods by order (s), over their errors on a segment (n,)."""
    curves, reference = Curves(), references.burg(x, max(times))
    for order, spent in times.items():
        expected = references.step_up(reference[:order])
        for method in methods:
            error = _error(method.coefficients(x, order), expected)
            curves.add(method.name, order, spent[method.name].times(MICROSECONDS), error)
    return curves.build()


def _stiff(methods: Sequence[BurgFit]) -> FindingsTable:
    rows: list[dict[str, Any]] = []
    for case in STIFF:
        expected = references.step_up(references.burg(case.signal, case.order))
        least = references.residual(case.signal, expected)
        for method in methods:
            row = {"case": case.name, "order": case.order, "method": method.name}
            rows.append(row | _held(method, case, expected, least))
    return FindingsTable("stiff", "Stiff and extreme segments", tuple(rows))


def _held(
    method: BurgFit, case: signals.StiffCase, expected: Sequence[Any], least: Any
) -> dict[str, Any]:
    try:
        ar = method.coefficients(case.signal, case.order)
        if method.name == OURS:
            stable = bool((np.abs(burg(case.signal, case.order).reflection) < 1.0).all())
        else:
            stable = len(ar) == case.order and references.is_stable(ar)
    except peers.FAILURES as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        return {"stable": False, "error": None, "residual": None, "remark": f"raises: {reason}"}
    if len(ar) != case.order or not np.isfinite(ar).all():
        return {"stable": False, "error": None, "residual": None, "remark": "no such filter"}
    left = references.residual(case.signal, references.exact(ar))
    ratio = float(left / least) if least else None
    return {"stable": stable, "error": _error(ar, expected), "residual": ratio, "remark": ""}


def _speed_target(panel: Panel, least: float) -> Target:
    ratio = min(panel.x_ratios("librosa", OURS).values(), default=None)
    return Target(f"librosa over mmt, {panel.title}: least ratio", ratio, "at least", least)


def _stiff_targets(stiff: FindingsTable) -> list[Target]:
    cases = len({row["case"] for row in stiff.rows})
    held: dict[str, int] = {}
    for row in stiff.rows:
        held[str(row["method"])] = held.get(str(row["method"]), 0) + bool(row["stable"])
    others = [count for name, count in held.items() if name != OURS]
    most = float(max(others)) if others else None
    return [
        Target(f"stiff cases of {cases} that mmt holds", held[OURS], "at least", cases),
        Target(f"stiff cases of {cases} that the best peer holds", most, "at most", cases - 1),
    ]
