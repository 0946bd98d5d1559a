"""Synthesis: what a rarer renewal of the filter saves, and what it changes."""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import cycle
from typing import Final

import numpy as np
from scipy.signal import lfilter

from mmt.core.arrays import FloatArray
from mmt.testing.simulation.textures import get_surface
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.bench import c_loops
from mmt_lab.bench.measuring import call_times, interleave, spread
from mmt_lab.bench.textures import exact_samples, scattered, session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    Axis,
    Cell,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    SkippedMethod,
    Target,
)

OURS: Final = "mmt"
SCIPY: Final = "scipy, direct form"
C: Final = "C, excitation given"
EXCITATION: Final = "excitation"
TIME: Final = Axis("time of a sample (ns)", "ns")
ERROR: Final = Axis("rms of the difference over that of the vibration", "error")
TARGET_RENEWAL: Final = 10
_NANOSECONDS: Final = 1e9
_MICROSECOND: Final = 1e-6

Motion = tuple[FloatArray, FloatArray]
"""Speed (mm/s) and normal force (N) at every sample, (n,)."""

SURFACE: Final = "wood"
SAMPLES: Final = 40
ORDER: Final = 16
RENEWALS: Final = (1, 5, TARGET_RENEWAL, 50, 100)
DURATION_S: Final = 18.0
TIMED_SAMPLES: Final = 4000
CALLS: Final = 10_000
ROUNDS: Final = 7


def run() -> Findings:
    """Measure blocks at every renewal, one-sample calls, and the same loop in C."""
    surface = get_surface(SURFACE)
    samples = exact_samples(surface, *scattered(SAMPLES, 0), ORDER)
    model = TextureModel(samples, method="published")
    motion = _motion()
    curves, rates = Curves(), {}
    reference = _render(model, motion, 1)
    part = _stretch(motion)
    noise = np.random.default_rng(1).standard_normal(TIMED_SAMPLES)
    direct = by_scipy(model, part, 1, noise)
    with c_loops.compiled() as loops:
        for renewal in RENEWALS:
            tasks = _tasks(model, part, renewal, noise, loops)
            own = _difference(_render(model, motion, renewal), reference)
            errors = {SCIPY: _difference(by_scipy(model, part, renewal, noise), direct)}
            for name, time in interleave(tasks, ROUNDS).items():
                one = time.times(_NANOSECONDS / TIMED_SAMPLES)
                rates[name, renewal] = _NANOSECONDS / one.median
                if name != EXCITATION:
                    curves.add(name, renewal, one, errors.get(name, own))
    calls, p99_us = _calls(model, motion)
    return Findings(
        title="Synthesis",
        about=(
            f"A model of {SAMPLES} samples of order {ORDER} on the texture "
            f"{SURFACE}, rendered for the {DURATION_S:g} s course of speed and force "
            "of a simulated hand, with the same excitation at every renewal. The error is "
            "against renewal at every sample, whose own error is zero and is drawn at the "
            "bottom. C: the same loop (-O3, this processor), to which the excitation is given. "
            "scipy: the model's filters in direct form by scipy.signal.lfilter, its state "
            "carried over, against itself."
        ),
        panels=(
            Panel("renewal", "Blocks, by renewal", "samples a renewal", TIME, ERROR, curves.done()),
        ),
        records=(_rates(rates), calls),
        targets=_targets(rates, p99_us),
        left_out=(loops,) if isinstance(loops, SkippedMethod) else (),
    )


def _motion() -> Motion:
    """Return speed and force of a simulated hand, as the modelling derives them."""
    recorded = session(SURFACE, DURATION_S)
    block = StreamFilter().process(recorded.frames)
    return np.array(block.speed_mm_s), np.array(block.normal_force_n)


def _stretch(motion: Motion) -> Motion:
    """Return a stretch of the motion from its middle, for the clock."""
    start = max(0, (len(motion[0]) - TIMED_SAMPLES) // 2)
    first, second = (np.resize(values[start:], TIMED_SAMPLES) for values in motion)
    return first, second


def _render(model: TextureModel, motion: Motion, renewal: int) -> FloatArray:
    return Synthesizer(model, seed=1, renewal_samples=renewal).render(*motion)


def _difference(found: FloatArray, reference: FloatArray) -> float:
    return float(np.linalg.norm(found - reference) / np.linalg.norm(reference))


def _tasks(
    model: TextureModel,
    motion: Motion,
    renewal: int,
    noise: FloatArray,
    loops: c_loops.Loops | SkippedMethod,
) -> dict[str, Callable[[], object]]:
    synthesizer = Synthesizer(model, seed=1, renewal_samples=renewal)
    generator = np.random.default_rng(1)
    tasks: dict[str, Callable[[], object]] = {
        OURS: lambda: synthesizer.render(*motion),
        SCIPY: lambda: by_scipy(model, motion, renewal, noise),
        EXCITATION: lambda: generator.standard_normal(len(noise)),
    }
    if isinstance(loops, c_loops.Loops):
        tasks[C] = loops.render_call(model, motion, renewal, noise, np.empty(len(noise)))
    return tasks


def by_scipy(model: TextureModel, motion: Motion, renewal: int, noise: FloatArray) -> FloatArray:
    """Render with scipy's filter in direct form; (n,), as the papers describe it."""
    state = np.zeros(model.order)
    output = np.empty(len(noise))
    for start in range(0, len(noise), renewal):
        part = slice(start, start + renewal)
        lsf, variance = model.at(motion[0][start], motion[1][start])
        ar = np.concatenate([[1.0], lsf_to_ar(lsf)[0]])
        excitation = math.sqrt(variance[0]) * noise[part]
        output[part], state = lfilter([1.0], ar, excitation, zi=state)
    return output


def _calls(model: TextureModel, motion: Motion) -> tuple[FindingsTable, float]:
    """Return the times of one-sample calls, and the median over rounds of their p99 (us)."""
    ones = list(zip(*(values.reshape(-1, 1) for values in motion), strict=True))
    p50, p99 = [], []
    for _ in range(ROUNDS):
        synthesizer = Synthesizer(model, seed=1)
        moments = cycle(ones)
        times = call_times(partial(_render_next, synthesizer, moments), CALLS)
        p50.append(float(np.median(times)) / _MICROSECOND)
        p99.append(float(np.percentile(times, 99.0)) / _MICROSECOND)
    rows: list[Mapping[str, Cell]] = []
    for name, values in (("p50", p50), ("p99", p99)):
        of = spread(np.array(values))
        rows.append({"": name, "median (µs)": of.median, "from (µs)": of.low, "to (µs)": of.high})
    title = f"Calls for one sample, renewed each: {ROUNDS} rounds of {CALLS} calls"
    return FindingsTable("calls", title, tuple(rows)), spread(np.array(p99)).median


def _render_next(synthesizer: Synthesizer, moments: Iterator[Motion]) -> FloatArray:
    return synthesizer.render(*next(moments))


def _rates(rates: dict[tuple[str, int], float]) -> FindingsTable:
    rows = []
    for renewal in RENEWALS:
        ours = rates[OURS, renewal]
        row: dict[str, float | None] = {
            "samples a renewal": renewal,
            "mmt (million/s)": ours / 1e6,
            "scipy (million/s)": rates[SCIPY, renewal] / 1e6,
        }
        if (C, renewal) in rates:
            kernel_ns = _NANOSECONDS / ours - _NANOSECONDS / rates[EXCITATION, renewal]
            row["C (million/s)"] = rates[C, renewal] / 1e6
            row["numba over C"] = kernel_ns * rates[C, renewal] / _NANOSECONDS
        rows.append(row)
    title = "Samples a second on one core, in blocks; numba over C: times without the excitation's"
    return FindingsTable("rates", title, tuple(rows))


def _targets(rates: dict[tuple[str, int], float], p99_us: float) -> tuple[Target, ...]:
    rate = rates.get((OURS, TARGET_RENEWAL))
    what = f"million samples/s in blocks, renewed every {TARGET_RENEWAL} samples"
    return (
        Target("call for one sample, p99 (µs)", p99_us, "at most", 15.0),
        Target(what, None if rate is None else rate / 1e6, "at least", 5.0),
    )


EXPERIMENT = Experiment(
    shows="what a rarer renewal of the filter saves, and what it changes",
    duration="20 s",
    run=run,
    group="bench",
)
