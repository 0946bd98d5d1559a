"""Line spectral frequencies in rendering: filters swapped at every sample, pauses, stiff fits."""

import time
from functools import partial
from typing import Final

import numpy as np

from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power, reflection_to_lsf
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.stability.families import CaseResult, Extreme, Family, ar

HOUR_SAMPLES: Final = 3_600_000

_BLOCK: Final = 10_000
_QUARTERS: Final = 4
_FLAT: Final = 1.5
"""Largest ratio of the time per sample between quarters of a run on a shared machine."""

_SPEED_MM_S, _FORCE_N = 300.0, 3.0


def cases(*, swaps: int = HOUR_SAMPLES, renders: int = 300) -> list[Extreme]:
    """Return the family's cases."""
    return [
        *(
            Extreme(
                f"{what} of order 16 swapped at every one of {count} samples",
                f"power the model's to 2 %, peak under 8 deviations, flat within {_FLAT:g} x",
                partial(_swaps, spread, count),
            )
            for what, spread, count in (
                ("50 ordinary filters", 0.6, swaps),
                ("50 stiff filters, |k| to 0.9999", 2.0, swaps // 10),
            )
        ),
        Extreme(
            f"strokes and pauses of 1 s, {swaps} samples",
            f"silent pauses, time a sample within {_FLAT:g} x of the strokes'",
            partial(_pauses, swaps),
        ),
        *(
            Extreme(
                f"render the fit of pole pairs at radius {radius:g}, order {order}",
                "power within 5 standard errors of the segment's",
                partial(_stiff_power, radius, order, renders),
            )
            for radius in (0.999, 0.999999)
            for order in (10, 24, 64)
        ),
    ]


def many_filters(spread: float) -> TextureModel:
    """Return a model of 50 random filters of order 16, all of power one, at random points."""
    generator, count = np.random.default_rng(7), 50
    k = np.clip(np.tanh(generator.normal(0.0, spread, (count, 16))), -0.9999, 0.9999)
    return TextureModel(
        TextureSamples.isotropic(
            generator.uniform(0.0, _SPEED_MM_S, count),
            generator.uniform(0.0, _FORCE_N, count),
            reflection_to_lsf(k),
            1.0 / output_power(1.0, k),
            np.ones(count),
        )
    )


def _swaps(spread: float, samples: int) -> CaseResult:
    """Render random points of the plane, away from its silent edges, without any limit."""
    generator = np.random.default_rng(8)
    model = many_filters(spread)
    synthesizer = Synthesizer(model, limit_m_s2=np.inf, seed=3)
    power = expected = peak = 0.0
    seconds = []
    for _ in range(samples // _BLOCK):
        speed = generator.uniform(0.3 * _SPEED_MM_S, _SPEED_MM_S, _BLOCK)
        force = generator.uniform(0.3 * _FORCE_N, _FORCE_N, _BLOCK)
        started = time.thread_time()
        output = synthesizer.render(speed, force)
        seconds.append(time.thread_time() - started)
        power += float(np.mean(output**2))
        lsf, variance = model.at(speed[:100], force[:100])
        expected += float(output_power(variance, lsf_to_reflection(lsf)).mean())
        peak = max(peak, float(np.abs(output).max()))
    error = power / expected - 1.0
    ratio, nanoseconds = _flatness(seconds)
    return CaseResult(
        f"power off by {error:+.1%}, peak {peak:.1f}, {nanoseconds:.0f} ns, {ratio:.2f} x",
        held=abs(error) < 0.02 and peak < 8.0 and ratio < _FLAT,
        figures={"power_error": error, "peak": peak, "ns_per_sample": nanoseconds, "flat": ratio},
    )


def _flatness(seconds: list[float]) -> tuple[float, float]:
    """Return slowest over quickest quarter of a run, and ns a sample.

    A quarter's time is the tenth percentile of its blocks' processor time, which other work on the
    machine hardly affects.
    """
    quick = [float(np.quantile(part, 0.1)) for part in np.array_split(seconds, _QUARTERS)]
    return max(quick) / min(quick), 1e9 * min(quick) / _BLOCK


def _pauses(samples: int) -> CaseResult:
    """Alternate strokes and pauses, in which a filter's memory could become denormal."""
    synthesizer = Synthesizer(many_filters(2.0), renewal_samples=10, seed=3)
    force = np.full(1000, 1.5)
    stroke, rest = np.full(1000, 150.0), np.zeros(1000)
    loud: list[float] = []
    quiet: list[float] = []
    heard = 0.0
    for _ in range(samples // 2000):
        for speed, seconds in ((stroke, loud), (rest, quiet)):
            started = time.thread_time()
            output = synthesizer.render(speed, force)
            seconds.append(time.thread_time() - started)
        heard = max(heard, float(np.abs(output[200:]).max()))
    ratio = float(np.quantile(quiet, 0.1) / np.quantile(loud, 0.1))
    return CaseResult(
        f"pauses {'silent' if heard == 0.0 else f'of {heard:.0e} m/s2'}, {ratio:.2f} x",
        held=heard == 0.0 and ratio < _FLAT,
        figures={"heard_m_s2": heard, "pause_over_stroke": ratio},
    )


def _stiff_power(radius: float, order: int, renders: int) -> CaseResult:
    """Render many realisations of one fit, each of two seconds."""
    segment = ar.poles(radius, ar.CLUSTERED_RAD)
    fit = burg(segment / np.sqrt(np.mean(segment**2)), order)
    model = TextureModel(
        TextureSamples.isotropic(
            np.array([150.0]),
            np.array([1.5]),
            reflection_to_lsf(fit.reflection)[np.newaxis],
            np.array([fit.variance]),
            np.array([fit.power]),
        )
    )
    hold = np.full(2000, 150.0), np.full(2000, 1.5)
    powers = np.array(
        [
            np.mean(
                Synthesizer(model, seed=seed, renewal_samples=100, limit_m_s2=np.inf).render(*hold)
                ** 2
            )
            for seed in range(renders)
        ]
    )
    off = float(powers.mean() / fit.power - 1.0)
    error = float(powers.std() / np.sqrt(renders) / fit.power)
    return CaseResult(
        f"power off by {off:+.1%}, standard error {error:.1%}",
        held=abs(off) <= 5.0 * error and error < 0.2,
        figures={"power_error": off, "standard_error": error},
    )


FAMILY: Final = Family("Line spectral frequencies and rendering", cases)
