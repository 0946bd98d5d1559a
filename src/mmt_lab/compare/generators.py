"""Judge external generators on one session, by the vibration that they render at its strokes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.evaluation.reports.document import ReportTable, table_of
from mmt.evaluation.strokes_made import StrokesMade
from mmt.evaluation.texts import number
from mmt.evaluation.truth import KnownTexture
from mmt_lab.compare.cases import ComparisonCase
from mmt_lab.compare.judging import METHODS, PERIOD_S, TIMES_S, JudgedMethod, blocks_of, settings_of
from mmt_lab.compare.rendered_spectra import (
    BLOCK_SAMPLES,
    RATE_HZ,
    RUN_S,
    STROKES,
    expected_spectra,
    render_strokes,
    rendered_errors,
    spectra_of,
)
from mmt_lab.compare.time_limit import time_limit
from mmt_methods.generators.building import GeneratorModeller
from mmt_methods.generators.guarded import GeneratorFault, GuardedGenerator
from mmt_methods.generators.registry import load

NUMBERS: Final = {round(time_s / PERIOD_S) - 1: time_s for time_s in TIMES_S}
"""Times at which generators are judged, by the number of the update that ends then."""

LONGEST_UPDATE_S: Final = 60.0
"""An update that takes longer ends the session for its generator."""

BLOCK_US: Final = BLOCK_SAMPLES / RATE_HZ * 1e6

DEFINITIONS: Final = {
    "generators": f"by vibration rendered at {STROKES} of the strokes that were made: two runs of "
    f"{RUN_S:g} s at each, Welch's spectra of 500 samples (GFC: of 64), against the texture's "
    "spectrum through the same windows; means of the product of the two runs' errors, so that "
    "their scatter cancels. The share is by the mean of the two runs",
    "scatter": "of the estimate of a level by both runs, root mean square over the strokes, dB: "
    "half the difference of the runs",
    "time of a block": "of 10 ms at 1 kHz; percentiles of a session, medians over the sessions",
    "time of an update": "from the new frames of a second to a generator that renders: filters and "
    "segments included",
}


@dataclass(frozen=True)
class GeneratorScore:
    """Score of a generator at one time of one session, by its rendered vibration.

    ``judged`` has no figures over the plane, and the number of segments as ``samples``. ``clipped``
    is the share of samples clipped, ``block_us`` the median and 99th percentile of the time to
    render 10 ms, ``update_ms`` the median and the longest update so far.
    """

    judged: JudgedMethod
    scatter_db: float
    clipped: float
    block_us: tuple[float, float]
    update_ms: tuple[float, float]


@dataclass(frozen=True)
class Fault:
    """Why a generator was not judged to the end of a session."""

    generator: str
    name: str
    texture: str
    seed: int
    reason: str


def check_generators(names: Sequence[str]) -> None:
    """Raise `InputError` if a generator is unknown, named as a method, or named twice."""
    for name in names:
        load(name)
    taken = [name for name in names if name.partition("-")[0] in METHODS]
    if taken or len(set(names)) != len(names):
        raise InputError(
            f"--generators {','.join(names)}: name each once, and none as one of the methods "
            f"{', '.join(METHODS)}"
        )


def judge_generators(
    case: ComparisonCase, generators: Sequence[str], run_s: float = RUN_S
) -> tuple[list[GeneratorScore], list[Fault]]:
    """Judge generators on one session by the vibration that they render at its strokes.

    Each is updated over the session, and its state judged at the times of `NUMBERS`.
    """
    settings = settings_of(case, "field")
    blocks = blocks_of(case.session())
    strokes = StrokesMade.from_frames(blocks, settings).strokes(STROKES)
    expected = expected_spectra(KnownTexture(case.surface), strokes)
    rendered: list[GeneratorScore] = []
    faults = []
    for name in generators:
        modeller = GeneratorModeller(name, load(name), settings)
        try:
            for time_s, source, updates_ms in _states(modeller, name, blocks):
                before = source.samples, source.clipped
                vibration, blocks_us = render_strokes(source, strokes, case.seed, run_s)
                clipped = (source.clipped - before[1]) / (source.samples - before[0])
                figures, scatter_db = rendered_errors(spectra_of(vibration), expected)
                judged = JudgedMethod(
                    **case.labels,
                    spoil="",
                    method=source.name,
                    moment=f"{time_s:g} s",
                    time_s=time_s,
                    samples=modeller.segments,
                    figures=figures,
                )
                p50_us, p99_us = np.percentile(blocks_us, (50.0, 99.0)).tolist()
                times_ms = float(np.median(updates_ms)), max(updates_ms)
                rendered.append(
                    GeneratorScore(judged, scatter_db, clipped, (p50_us, p99_us), times_ms)
                )
        except GeneratorFault as fault:
            faults.append(Fault(name, case.name, case.texture, case.seed, str(fault)))
    return rendered, faults


def _states(
    modeller: GeneratorModeller, name: str, blocks: Sequence[RecordArray]
) -> Iterator[tuple[float, GuardedGenerator, list[float]]]:
    """Update a generator; yield each time of `NUMBERS`, its state, and all updates' times in ms."""
    late = f"generator {name}: an update took longer than {LONGEST_UPDATE_S:g} s"
    updates_ms = []
    for place, block in enumerate(blocks):
        started = perf_counter()
        with time_limit(LONGEST_UPDATE_S, late):
            source = modeller.update(block)
        updates_ms.append(1e3 * (perf_counter() - started))
        if place in NUMBERS and source is not None:
            yield NUMBERS[place], source, updates_ms
    if modeller.generator is None:
        raise GeneratorFault(f"generator {name}: the builder returned None for the whole session")


def generators_table(rendered: Sequence[GeneratorScore]) -> ReportTable:
    """Return the generators' run times, the scatter of the error estimates, and clipping."""
    rows = []
    for name in dict.fromkeys(one.judged.method for one in rendered):
        mine = [one for one in rendered if one.judged.method == name]
        block = np.median([one.block_us for one in mine], axis=0)
        rows.append(
            {
                "generator": name,
                "block p50 (µs)": number(float(block[0]), 0),
                "p99 (µs)": number(float(block[1]), 0),
                "update (ms)": number(float(np.median([one.update_ms[0] for one in mine])), 1),
                "longest (ms)": number(max(one.update_ms[1] for one in mine), 1),
                "scatter (dB)": number(float(np.median([one.scatter_db for one in mine])), 2),
                "clipped": f"{100 * np.mean([one.clipped for one in mine]):.2g} %",
            }
        )
    caption = "Times in this run, the scatter of the estimates, and samples beyond the limit."
    return table_of(rows, caption)


def generator_sentences(rendered: Sequence[GeneratorScore]) -> list[str]:
    """Return a sentence on each generator that is too slow for the tick on this machine."""
    sentences = []
    for name in dict.fromkeys(one.judged.method for one in rendered):
        late = [one.block_us[1] > BLOCK_US for one in rendered if one.judged.method == name]
        if any(late):
            sentences.append(
                f"{name} is not for the tick on this machine: at {sum(late)} of {len(late)} times "
                "one block of 10 ms in a hundred took longer than 10 ms."
            )
    return sentences


def failures(faults: Sequence[Fault]) -> list[str]:
    """Return why generators were not judged to the end, each reason once."""
    found: dict[str, list[Fault]] = {}
    for fault in faults:
        found.setdefault(fault.reason, []).append(fault)
    return [
        f"{reason} (in {len(of)} session{'s' * (len(of) > 1)}, the first {of[0].name} with seed "
        f"{of[0].seed})"
        for reason, of in found.items()
    ]
