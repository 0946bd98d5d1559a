"""The one-second update as the model grows: each stage of it, and the rendering beside it."""

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.testing.simulation.textures import get_surface
from mmt.texture.autoregression.effective_sample_size import UNKNOWN
from mmt.texture.model.fits import Fit
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.segmentation.segments import SampleRange, Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.bench.measuring import interleave, spread
from mmt_lab.bench.textures import exact_samples, scattered, session
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    MICROSECONDS,
    Axis,
    Cell,
    Curves,
    Findings,
    FindingsTable,
    Panel,
    Target,
)

SAMPLES: Final = Axis("samples of the model", "samples")
TIME_MS: Final = Axis("time (ms)", "ms")
CALL: Final = Axis("time of a call (µs)", "µs", logarithmic=False)
WHOLE: Final = "whole update"
ONE_SAMPLE: Final = "one sample"
MOVING: Final = "one sample, from anywhere to anywhere"
_MILLISECONDS: Final = 1e3
_SECOND: Final = 1000
_PAST_FIXED_COSTS: Final = -3  # of the sizes: what does not grow would hide what does

Points = list[tuple[FloatArray, FloatArray]]
"""Speed and force, (1,) each, of one call after the other."""

SURFACE: Final = "wood"
COUNTS: Final = (10, 20, 50, 100, 200, 400)
ORDER: Final = 16
SECONDS: Final = 12
FIRST_SECOND: Final = 4
REPEATS: Final = 3
CALLS: Final = 2000
ROUNDS: Final = 7


def run() -> Findings:
    """Measure updates of models of every size, and calls for one sample from them."""
    blocks = _blocks()
    stages = _stages(blocks)
    calls = _calls()
    return Findings(
        title="Model update",
        about=(
            "The newest second of a simulated session enters a model that already has that many "
            "samples, scattered over the plane. Every second of "
            f"{SECONDS - FIRST_SECOND}, {REPEATS} times, in turns; median and "
            "quartiles over all. Filtering, segmenting and fitting concern the new second "
            "alone. The one-sample call renders along a hand's course, or jumps at random."
        ),
        panels=(stages, calls),
        records=(_growth(stages, calls),),
        targets=_targets(stages, calls),
    )


def _blocks() -> list[RecordArray]:
    frames = session(SURFACE, float(SECONDS)).frames
    return [frames[i : i + _SECOND] for i in range(0, len(frames), _SECOND)]


def _stages(blocks: Sequence[RecordArray]) -> Panel:
    """Time updates of all sizes in turns."""
    durations: dict[int, dict[str, list[float]]] = {count: {} for count in COUNTS}
    extra = {count: _fits(count) for count in COUNTS}
    for _ in range(REPEATS):
        modeller = OnlineModeller(ModellingSettings(order=ORDER))
        for number, block in enumerate(blocks):
            if number >= FIRST_SECOND:
                for count in COUNTS:
                    grown = copy.deepcopy(modeller)
                    grown.fits.clear()
                    grown.fits.update(extra[count])
                    _note(durations[count], grown.update(block).durations_s)
            modeller.update(block)
    curves = Curves()
    for count, of in durations.items():
        for name, values in of.items():
            curves.add(name, count, count, spread(np.array(values)).times(_MILLISECONDS))
    return Panel("stages", "Stages of an update", "samples", SAMPLES, TIME_MS, curves.done())


def _note(durations: dict[str, list[float]], laps: dict[str, float]) -> None:
    for name, seconds in {**laps, WHOLE: sum(laps.values())}.items():
        durations.setdefault(name, []).append(seconds)


def _samples(count: int) -> TextureSamples:
    return exact_samples(get_surface(SURFACE), *scattered(count, 0), ORDER)


def _fits(count: int) -> dict[SampleRange, Fit]:
    """Return samples as if they had been fitted long before the session."""
    samples = _samples(count)
    fits = {}
    for index in range(count):
        start = -_SECOND * (index + 2)
        segment = Segment(
            start=start,
            stop=start + 200,
            speed_mm_s=float(samples.speed_mm_s[index]),
            velocity_mm_s=(float(samples.speed_mm_s[index]), 0.0),
            force_n=float(samples.force_n[index]),
            vibration_m_s2=np.zeros(200),
            time_ns=0,
            final=True,
        )
        fits[segment.span] = Fit(
            segment=segment,
            lsf=samples.lsf[index],
            variance=float(samples.variance[index]),
            power=float(samples.power[index]),
            effective=UNKNOWN,
            count=200,
        )
    return fits


def _calls() -> Panel:
    """Time calls for one sample from models of all sizes in turns."""
    along, across = _course(), _jumps()
    tasks = {}
    for count in COUNTS:
        model = TextureModel(_samples(count))
        for name, points in ((ONE_SAMPLE, along), (MOVING, across)):
            tasks[f"{name}/{count}"] = _render_all(model, points)
    curves = Curves()
    for key, time in interleave(tasks, ROUNDS).items():
        name, _, samples = key.rpartition("/")
        curves.add(name, int(samples), int(samples), time.times(MICROSECONDS / CALLS))
    return Panel("calls", "Rendering", "samples", SAMPLES, CALL, curves.done())


def _render_all(model: TextureModel, points: Points) -> Callable[[], None]:
    synthesizer = Synthesizer(model, seed=1)

    def render() -> None:
        for speed_mm_s, force_n in points:
            synthesizer.render(speed_mm_s, force_n)

    return render


def _course() -> Points:
    """Return a hand's speed and force, sample by sample, which move continuously."""
    phase = np.arange(CALLS) * (2 * np.pi / 1000)
    return _ones(150.0 + 140.0 * np.sin(phase), 1.5 + 1.4 * np.sin(1.7 * phase))


def _jumps() -> Points:
    return _ones(*scattered(CALLS, 1))


def _ones(speed_mm_s: FloatArray, force_n: FloatArray) -> Points:
    return list(zip(speed_mm_s.reshape(-1, 1), force_n.reshape(-1, 1), strict=True))


def _growing(stages: Panel, calls: Panel) -> list[tuple[str, Panel, bool]]:
    """Return what is to grow no faster than n log n, and than log n where that is False."""
    named = [(WHOLE, stages, True), ("triangulate", stages, True)]
    return [*named, (ONE_SAMPLE, calls, False), (MOVING, calls, False)]


def _growth(stages: Panel, calls: Panel) -> FindingsTable:
    rows: list[Mapping[str, Cell]] = [
        {
            "what": name,
            "from": int(before.knob),
            "to": int(after.knob),
            "time grows by": after.y.median / before.y.median,
            "n log n grows by": _n_log_n(after.knob) / _n_log_n(before.knob),
            "log n grows by": math.log(after.knob) / math.log(before.knob),
        }
        for name, panel, _ in _growing(stages, calls)
        for before, after in pairwise(panel.points(name))
    ]
    return FindingsTable("growth", "Growth from one size to the next", tuple(rows))


def _targets(stages: Panel, calls: Panel) -> tuple[Target, ...]:
    targets = []
    for name, panel, with_samples in _growing(stages, calls):
        points = panel.points(name)
        first, last = points[_PAST_FIXED_COSTS if with_samples else 0], points[-1]
        law, words = (_n_log_n, "n log n") if with_samples else (math.log, "log n")
        growth = last.y.median / first.y.median / (law(last.knob) / law(first.knob))
        what = f"{name}: growth from {first.knob:g} to {last.knob:g} samples over that of {words}"
        targets.append(Target(what, growth, "at most", 1.0))
    return tuple(targets)


def _n_log_n(samples: float) -> float:
    return samples * math.log(samples)


EXPERIMENT = Experiment(
    shows="how the cost of an update and of a rendered sample grows with the model",
    duration="1 min",
    run=run,
    group="bench",
)
