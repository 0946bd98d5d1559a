"""Generators beside our methods over all sessions: tables, sentences and data."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.evaluation.document import Block, Heading, Table
from mmt.evaluation.texts import number
from mmt.texture.generators.registry import load
from mmt_lab.compare.cases import Case
from mmt_lab.compare.generators import Fault, Rendered, RenderedSession, Times, judge_rendered
from mmt_lab.compare.judging import METHODS, MOMENTS
from mmt_lab.compare.rendered_spectra import BLOCK_SAMPLES, RATE_HZ, RUN_S, STROKES
from mmt_lab.compare.summary import MethodComparison
from mmt_lab.compare.tables import DIGITS, difference_sentences, errors_table, shares_table
from mmt_lab.harness.processes import each

BLOCK_US: Final = BLOCK_SAMPLES / RATE_HZ * 1e6

DEFINITIONS: Final = {
    "as rendered": f"by vibration rendered at {STROKES} of the strokes that were made: two runs of "
    f"{RUN_S:g} s at each, Welch's spectra of 500 samples (GFC: of 64), "
    "against the texture's spectrum through the same windows; means of the product of the two "
    "runs' errors, so that their scatter cancels. The share is by the mean of the two runs",
    "scatter": "of the estimate of a level by both runs, root mean square over the strokes, dB: "
    "half the difference of the runs",
    "time of a block": "of 10 ms at 1 kHz, along the last 10 s of the session's own strokes, all "
    "methods in turns; percentiles of a session, medians over the sessions",
    "time of an update": "from new frames, one a second, to a model or generator that renders: "
    "filters and segments included",
}


@dataclass(frozen=True)
class RenderedComparison:
    """Everything that was judged by what it renders.

    Attributes
    ----------
    methods, generators
        Names; differences are from the first method.
    sessions
        What came of each session.
    """

    methods: tuple[str, ...]
    generators: tuple[str, ...]
    sessions: tuple[RenderedSession, ...]

    @cached_property
    def rendered(self) -> list[Rendered]:
        """Everything that was judged, session by session."""
        return [one for session in self.sessions for one in session.rendered]

    @cached_property
    def times(self) -> list[Times]:
        """Times of each session."""
        return [one for session in self.sessions for one in session.times]

    @cached_property
    def faults(self) -> list[Fault]:
        """What ended a session for a generator."""
        return [one for session in self.sessions for one in session.faults]

    @cached_property
    def comparison(self) -> MethodComparison:
        """Methods and generators in one comparison, by what they render."""
        names = (*self.methods, *self.generators)
        return MethodComparison(names, tuple(one.judged for one in self.rendered))

    def tables(self) -> list[Table]:
        """Return the figures of each group, the check of the estimate, and the times."""
        tables = []
        for group in self.comparison.groups:
            for table in (shares_table, errors_table):
                found = table(self.comparison, group)
                caption = f"As rendered, {found.caption}"
                tables.append(Table(found.columns, found.rows, caption))
            tables.append(self._check(group))
        return [*tables, self._times()]

    def blocks(self) -> list[Block]:
        """Return everything for a report."""
        return [Heading("Generators, by what they render"), *self.tables()]

    def sentences(self) -> list[str]:
        """Say how each generator compares with the first method, and what is wrong with it."""
        sentences = []
        for name in self.generators:
            if any(one.judged.method == name for one in self.rendered):
                sentences += difference_sentences(self.comparison, name)
            clipped = [one.clipped for one in self.rendered if one.judged.method == name]
            if any(clipped):
                sentences.append(
                    f"{name} was beyond the actuator's limit in {100 * np.mean(clipped):.2g} % of "
                    "its samples, which were clipped."
                )
            late = [o.block_p99_us for o in self.times if o.method == name]
            slow = sum(time_us > BLOCK_US for time_us in late)
            if slow:
                sentences.append(
                    f"{name} is not for the tick on this machine: in {slow} of {len(late)} "
                    "sessions one block of 10 ms in a hundred took longer than 10 ms."
                )
        return [f"As rendered, {sentence}" for sentence in sentences]

    def failures(self) -> list[str]:
        """Say why generators were not judged to the end, each reason once."""
        sessions = len(self.sessions)
        found: dict[str, list[Fault]] = {}
        for fault in self.faults:
            found.setdefault(fault.reason, []).append(fault)
        return [
            f"{reason} (in {len(faults)} of {sessions} sessions, the first {faults[0].name} with "
            f"seed {faults[0].seed})"
            for reason, faults in found.items()
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        whole = self.comparison.as_dict()
        return {
            "methods": list(self.comparison.methods),
            "rows": whole["rows"],
            "differences": whole["differences"],
            "sessions": [
                {
                    **asdict(one.judged),
                    "exact": one.exact,
                    "scatter_db": one.scatter_db,
                    "clipped": one.clipped,
                }
                for one in self.rendered
            ],
            "times": [asdict(one) for one in self.times],
            "faults": [asdict(one) for one in self.faults],
        }

    def _check(self, group: str) -> Table:
        """Return, for each method, the scatter, and estimates beside a model's own figures."""
        rows = []
        for moment in MOMENTS:
            for method in self.comparison.methods:
                key = (group, moment, method)
                chosen = [one for one in self.rendered if _key(one) == key]
                if chosen:
                    rows.append([moment, method, *_check_cells(chosen)])
        columns = ["moment", "method", "scatter (dB)", "share", "level (dB)", "GFC"]
        caption = (
            f"{group}, what the estimate is worth: its scatter, and its figures / those of a "
            "model's own spectra at the same points, which generators do not have; medians."
        )
        return Table([*columns, "spectrum (dB)", "bands (dB)"], rows, caption)

    def _times(self) -> Table:
        rows = []
        for method in self.comparison.methods:
            mine = [one for one in self.times if one.method == method]
            if mine:
                block = [(one.block_p50_us, one.block_p99_us) for one in mine]
                p50_us, p99_us = np.median(block, axis=0).tolist()
                rows.append(
                    [
                        method,
                        str(len(mine)),
                        number(p50_us, 0),
                        number(p99_us, 0),
                        number(float(np.median([one.update_ms for one in mine])), 1),
                        number(max(one.longest_update_ms for one in mine), 1),
                    ]
                )
        columns = ["method", "of", "block p50 (µs)", "p99 (µs)", "update (ms)", "longest (ms)"]
        return Table(columns, rows, "Times in this run, of a block of 10 ms, and of an update.")


def check_generators(names: Sequence[str]) -> None:
    """Raise `InputError` where a generator is not known, or its name is taken or named twice."""
    for name in names:
        load(name)
    taken = [name for name in names if name in METHODS]
    if taken or len(set(names)) != len(names):
        raise InputError(
            f"--generators {','.join(names)}: name each once, and none as one of the methods "
            f"{', '.join(METHODS)}"
        )


def compare_rendered(
    cases: Sequence[Case],
    methods: Sequence[str],
    generators: Sequence[str],
    workers: int | None = None,
) -> RenderedComparison:
    """Judge methods and generators on every session by what they render, in local processes."""
    calls = [(case, tuple(methods), tuple(generators)) for case in cases]
    found = each(judge_rendered, calls, workers=workers, what="rendering")
    return RenderedComparison(tuple(methods), tuple(generators), tuple(found))


def _key(one: Rendered) -> tuple[str, str, str]:
    return one.judged.group, one.judged.moment, one.judged.method


def _check_cells(chosen: Sequence[Rendered]) -> list[str]:
    cells = [number(float(np.median([one.scatter_db for one in chosen])), 2)]
    for figure in chosen[0].judged.figures:
        rendered = float(np.median([one.judged.figures[figure] for one in chosen]))
        exact = [one.exact[figure] for one in chosen if one.exact is not None]
        own = f" / {number(float(np.median(exact)), DIGITS[figure])}" if exact else ""
        cells.append(number(rendered, DIGITS[figure]) + own)
    return cells
