"""Line spectral frequencies beside their peers: time and accuracy of the conversion and back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import (
    ar_to_reflection,
    lsf_to_ar,
    lsf_to_reflection,
    reflection_to_lsf,
)
from mmt_lab.bench import peers, references, signals
from mmt_lab.bench.measuring import interleave
from mmt_lab.bench.signals import Filters
from mmt_lab.harness.findings import (
    MICROSECONDS,
    TIME_US,
    Axis,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    Target,
)

SHOWS: Final = "what line spectral frequencies cost and how exact they are beside their peers"
TAKES: Final = "1 min"
GROUP: Final = "bench"

OURS: Final = "mmt, reflection"
OURS_AR: Final = "mmt, coefficients"
PEER: Final = "pysptk"
ERROR: Final = Axis("largest error of a frequency (rad)", "error")
AR_ERROR: Final = Axis("error of the coefficients over the largest", "error")
TARGET_ORDER: Final = 16
LOW_PASS_ORDER: Final = 30
LARGEST: Final = 64
_FINER: Final = (512, 16, 1e-12)

Convert = Callable[[FloatArray], FloatArray]
"""From filters (n, m) to line spectral frequencies (n, m), or back."""

ORDERS: Final = (8, 10, 16, 24, 32, 40)
LOW_PASS_ORDERS: Final = (8, 16, 24, LOW_PASS_ORDER, 40, LARGEST)
BATCH: Final = 50
LOOKED_AT: Final = 5
ROUNDS: Final = 15


@dataclass(frozen=True)
class LsfMethod:
    """One implementation of both conversions; ``given`` names the form of its input filters."""

    name: str
    to_lsf: Convert
    back: Convert
    given: str = "ar"

    def start(self, given: Filters) -> FloatArray:
        """Return filters in the form that this method takes, (n, m)."""
        return given.reflection if self.given == "reflection" else given.ar


@peers.quiet()
def run() -> Findings:
    """Measure every implementation that is installed."""
    modules, left_out = peers.find((PEER, "spectrum"))
    methods = [
        LsfMethod(OURS, reflection_to_lsf, lsf_to_reflection, "reflection"),
        LsfMethod(OURS_AR, lambda ar: reflection_to_lsf(ar_to_reflection(ar)), lsf_to_ar),
        *_peers(modules),
    ]
    spread = {order: signals.spread_filters(order, BATCH) for order in ORDERS}
    there = _timed(methods, spread)
    low_pass = _low_pass(methods)
    largest = signals.spread_filters(LARGEST, LOOKED_AT)
    return Findings(
        title="Line spectral frequencies",
        about=(
            f"Batches of {BATCH} filters, time of one. Every form of a filter is rounded "
            f"from {references.DIGITS} digits. mmt starts from reflection coefficients, as "
            "Burg's method gives them, or from filter coefficients as the peers do. Errors "
            "are against the filter itself: what its coefficients lose by their rounding "
            "counts. pysptk searches a grid; its finer setting has 512 points, 16 steps, and "
            "1e-12 as its end."
        ),
        panels=(there, _back(methods, {**spread, LARGEST: largest}), low_pass),
        records=(_ratios(there),),
        targets=_targets(there, low_pass, largest),
        left_out=left_out,
    )


def _peers(modules: Mapping[str, ModuleType]) -> list[LsfMethod]:
    methods = []
    if PEER in modules:
        sptk: Any = modules[PEER]
        points, steps, end = _FINER

        def back(lsf: FloatArray) -> FloatArray:
            return np.asarray(sptk.lsp2lpc(_led(lsf)))[:, 1:]

        def finer(ar: FloatArray) -> FloatArray:
            return np.asarray(sptk.lpc2lsp(_led(ar), points, steps, end))[:, 1:]

        methods += [
            LsfMethod(PEER, lambda ar: sptk.lpc2lsp(_led(ar))[:, 1:], back),
            LsfMethod(f"{PEER}, finer", finer, back),
        ]
    if "spectrum" in modules:
        spectrum: Any = modules["spectrum"]
        methods.append(
            LsfMethod(
                "spectrum",
                lambda ar: np.array([spectrum.poly2lsf(row) for row in _led(ar)]),
                lambda lsf: np.array([spectrum.lsf2poly(list(row))[1:] for row in lsf]),
            )
        )
    return methods


def _led(rows: FloatArray) -> FloatArray:
    """Put the leading 1, or pysptk's gain, in front."""
    return np.hstack([np.ones((len(rows), 1)), rows])


def _timed(methods: Sequence[LsfMethod], cases: Mapping[int, Filters]) -> Panel:
    curves = Curves()
    for order, given in cases.items():
        calls = {m.name: partial(m.to_lsf, m.start(given)) for m in methods}
        errors = {}
        for name, call in calls.items():
            try:
                errors[name] = _error(call()[:LOOKED_AT], given.lsf)
            except peers.FAILURES as failure:
                curves.fail(name, order, str(failure))
        times = interleave({name: calls[name] for name in errors}, ROUNDS)
        for name, error in errors.items():
            curves.add(name, order, times[name].times(MICROSECONDS / BATCH), error)
    title = "To the frequencies, by order"
    return Panel("to_lsf", title, "order", TIME_US, ERROR, curves.build())


def _error(found: FloatArray, expected: Sequence[Sequence[Any]]) -> float:
    pairs = zip(found, expected, strict=False)
    return max(references.largest_error(np.asarray(row), exact) for row, exact in pairs)


def _low_pass(methods: Sequence[LsfMethod]) -> Panel:
    curves = Curves()
    for order in LOW_PASS_ORDERS:
        given = signals.low_pass_filter(order)
        for method in methods:
            try:
                error = _error(method.to_lsf(method.start(given)), given.lsf)
                curves.add(method.name, order, order, error)
            except peers.FAILURES as failure:
                curves.fail(method.name, order, str(failure))
    title = "Filters that Burg's method finds in low-pass noise, by order"
    axis = Axis("order", "order", logarithmic=False)
    return Panel("low_pass", title, "order", axis, ERROR, curves.build())


def _back(methods: Sequence[LsfMethod], cases: Mapping[int, Filters]) -> Panel:
    curves = Curves()
    backward = {m.name: m.back for m in methods if m.given == "ar" and "finer" not in m.name}
    for order, given in cases.items():
        lsf = np.resize(given.rounded_lsf, (BATCH, order))
        exact = [references.lsf_to_ar(row) for row in lsf[:LOOKED_AT]]
        times = interleave({name: partial(call, lsf) for name, call in backward.items()}, ROUNDS)
        for name, call in backward.items():
            error = _ar_error(call(lsf), exact)
            curves.add(name, order, times[name].times(MICROSECONDS / len(lsf)), error)
    title = "Back to coefficients, by order"
    return Panel("to_ar", title, "order", TIME_US, AR_ERROR, curves.build())


def _ar_error(found: FloatArray, exact: Sequence[Sequence[Any]]) -> float:
    largest = max(max(1.0, *(float(abs(value)) for value in row)) for row in exact)
    return _error(found, exact) / largest


def _ratios(there: Panel) -> FindingsTable:
    ratios = {name: there.x_ratios(PEER, name) for name in (OURS, OURS_AR)}
    rows = tuple(
        {
            "order": int(order),
            **{f"{PEER} over {name}": ratio[order] for name, ratio in ratios.items()},
        }
        for order in ratios[OURS]
    )
    return FindingsTable("ratios", "How many times faster", rows)


def _targets(there: Panel, low_pass: Panel, largest: Filters) -> tuple[Target, ...]:
    faster = there.x_ratios(PEER, OURS_AR).get(TARGET_ORDER)
    errors = {
        curve.method: {point.knob: point.y.median for point in curve.points}
        for curve in low_pass.curves
    }
    own = errors[OURS].get(LOW_PASS_ORDER)
    others = [
        at[LOW_PASS_ORDER] for name, at in errors.items() if name != OURS and LOW_PASS_ORDER in at
    ]
    ratio = min(others) / own if own and others else None
    lsf = largest.rounded_lsf
    error = _ar_error(lsf_to_ar(lsf), [references.lsf_to_ar(row) for row in lsf])
    speed = f"{PEER} over mmt, from coefficients, order {TARGET_ORDER}"
    by_way = (
        f"low-pass, order {LOW_PASS_ORDER}: least error by way of coefficients over that from"
        " reflection coefficients"
    )
    return (
        Target(speed, faster, "at least", 10.0),
        Target(by_way, ratio, "at least", 1000.0),
        Target(f"error back to coefficients at order {LARGEST}", error, "at most", 1e-12),
    )
