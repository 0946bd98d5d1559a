"""Methods of texture modelling side by side, on known textures and recorded strokes.

Each session is simulated once and modelled by every method. At four moments the models are
compared with the known texture; differences from the first method are paired, session by
session, with their noise. Methods that state their own uncertainty are checked against it.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

import typer

from mmt.evaluation.document import Block, Heading, Table
from mmt.evaluation.levels import BAND_EDGES_HZ
from mmt.evaluation.report_files import picture
from mmt_lab.compare.cases import Case, recorded_cases, simulated_cases
from mmt_lab.compare.certainty import Certainty, has_certainty, judge_certainty
from mmt_lab.compare.certainty_tables import DEFINITIONS as CERTAINTY_DEFINITIONS
from mmt_lab.compare.certainty_tables import (
    calibration_figure,
    calibration_sentence,
    calibration_table,
    criteria_table,
    deviation_table,
)
from mmt_lab.compare.judging import (
    METHODS,
    Judged,
    blocks_of,
    check_methods,
    judge,
)
from mmt_lab.compare.method_tables import (
    bands_table,
    difference_sentences,
    figures_table,
    shares_table,
)
from mmt_lab.compare.rendered_comparison import DEFINITIONS as RENDERED_DEFINITIONS
from mmt_lab.compare.rendered_comparison import (
    RenderedComparison,
    check_generators,
    compare_rendered,
)
from mmt_lab.compare.summary import ALL_RUN_TO_RUN_DB, STANDARD_ERRORS, MethodComparison
from mmt_lab.harness.experiment import (
    Experiment,
    HandKind,
    Seeds,
    Textures,
    Workers,
    chosen_textures,
    hand_of,
)
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import each

TITLE: Final = "Methods side by side"

GOAL: Final = 0.9
"""Share of the plane within one JND that a method should reach at the stop criterion."""

DEFINITIONS: Final = {
    "within_jnd": "share of the grid of the evaluation whose level is within one JND, 1.36 dB, of "
    "the known texture's, from 8 Hz up",
    "power_error_db": "root mean square of that level's error, dB",
    "gfc": "goodness of fit between expected Welch amplitude spectra, mean over the grid",
    "log_spectral_db": "log-spectral distance over 10 to 500 Hz, mean over the grid, dB",
    "band_error_db": "root mean square over the grid and nine bands of the error of a band's "
    "power, dB; the bands have edges at "
    + ", ".join(f"{edge:.0f}" for edge in BAND_EDGES_HZ)
    + " Hz",
    "run to run": "how the level of a band scatters between slides over one real material, "
    f"root mean square over the bands {ALL_RUN_TO_RUN_DB:.2f} dB",
    "moments": "3 s and 30 s of session time; the start and the stop criterion as the session's "
    "samples meet them. Sessions that do not come to a moment are not counted at it",
    "spread": "median, and 10th to 90th percentile, over the sessions",
    "difference": "mean over sessions of a method less the first, with its standard error; better "
    f"or worse where it exceeds {STANDARD_ERRORS:g} of them",
    "published": '[texture] method = "published": the excitation\'s variance, linearly in the '
    "triangles of paper A; on textures with a grain by the radial basis network of paper B",
    "field": '[texture] method = "field", the default: a Gaussian process of the level, and '
    "smoothed spectra",
    "recorded strokes": "scaled so that the 95th percentiles are 200 mm/s and 2 N; on every "
    "isotropic texture",
}

_CRITERIA: Final = "what time its thresholds take and what error they leave, medians."
_CALIBRATION: Final = "true shares by expected ones, over all updates."
_DEVIATIONS: Final = "standardised error by predicted standard deviation."


def method_tables(comparison: MethodComparison) -> list[Table]:
    """Return, for each group, the shares by texture and moment, and all figures of the group."""
    tables = []
    for group in comparison.groups:
        tables.append(shares_table(comparison, group))
        tables.append(figures_table(comparison, group))
        for method, sure in comparison.sure(group).items():
            tables.append(criteria_table(sure, f"{group}, {method}: {_CRITERIA}"))
    for method, sure in comparison.sure().items():
        tables.append(calibration_table(sure, f"{method}: {_CALIBRATION}"))
        tables.append(deviation_table(sure, f"{method}: {_DEVIATIONS}"))
    return tables


def verdicts(comparison: MethodComparison) -> list[str]:
    """Return in words where a method misses what it should reach, for each but the first."""
    sentences = []
    first = comparison.methods[0]
    simulated = [
        name
        for group in comparison.groups
        if group != "recorded strokes"
        for name in comparison.names(group)
    ]
    for method in comparison.methods[1:]:
        late = [name for name in simulated if _start_below_stop(comparison, name, method)]
        low = [name for name in simulated if _median(comparison, name, method, "stop") < GOAL]
        sentences += [
            f"{method} at the start criterion has the share that {first} has at the stop "
            f"criterion: {_but(late, simulated)}.",
            f"{method} has {GOAL:g} of the plane within one JND at the stop criterion: "
            f"{_but(low, simulated)}.",
        ]
        sentences += difference_sentences(comparison, method)
    return sentences + [
        calibration_sentence(sure, method) for method, sure in comparison.sure().items()
    ]


def method_blocks(comparison: MethodComparison) -> list[Block]:
    """Return every table and figure, for a report."""
    blocks: list[Block] = []
    for group in comparison.groups:
        blocks += [Heading(group.capitalize()), shares_table(comparison, group)]
        blocks += [figures_table(comparison, group), bands_table(comparison, group)]
        blocks += [Heading("By texture" if group != "recorded strokes" else "By stroke", 3)]
        blocks += [figures_table(comparison, name) for name in comparison.names(group)]
    return blocks + certainty_blocks(comparison)


def certainty_blocks(comparison: MethodComparison) -> list[Block]:
    """Return what methods say of their own error, and what the criteria make of it."""
    blocks: list[Block] = []
    for method, sure in comparison.sure().items():
        blocks.append(Heading(f"How sure {method} is"))
        blocks += [
            criteria_table(comparison.sure(group)[method], f"{group}: {_CRITERIA}")
            for group in comparison.groups
            if method in comparison.sure(group)
        ]
        figure = calibration_figure(sure)
        caption = "Each update of each session; means of bands; grey: where they agree."
        blocks.append(picture(f"calibration-{method}", caption, figure))
        blocks += [calibration_table(sure, _CALIBRATION), deviation_table(sure, _DEVIATIONS)]
        blocks.append(Heading("Criteria by texture", 3))
        names = list(dict.fromkeys(one.name for one in sure))
        blocks += [
            criteria_table(comparison.sure(name)[method], f"{name}: {_CRITERIA}") for name in names
        ]
    return blocks


def _median(comparison: MethodComparison, name: str, method: str, moment: str) -> float:
    """Return the median share, 1 where no session came to the moment: nothing is missed."""
    for row in comparison.rows(name):
        if (row.method, row.moment) == (method, moment):
            return row.spread["within_jnd"].median
    return 1.0


def _start_below_stop(comparison: MethodComparison, name: str, method: str) -> bool:
    published = _median(comparison, name, comparison.methods[0], "stop")
    moments = {row.moment for row in comparison.rows(name)}
    return "stop" in moments and _median(comparison, name, method, "start") < published


def _but(missed: Sequence[str], every: Sequence[str]) -> str:
    met = f"on {len(every) - len(missed)} of {len(every)} textures"
    return f"{met}, not on {', '.join(missed)}" if missed else met


def judge_session(case: Case, methods: Sequence[str]) -> tuple[list[Judged], list[Certainty]]:
    """Judge methods on one session, and what those that know their uncertainty say of it."""
    blocks = blocks_of(case)
    sure = [judge_certainty(case, method, blocks) for method in methods if has_certainty(method)]
    return judge(case, methods, blocks), sure


def compare(
    cases: Sequence[Case],
    methods: Sequence[str],
    remarks: Sequence[str] = (),
    workers: int | None = None,
) -> MethodComparison:
    """Judge methods on every session, in local processes."""
    calls = [(case, tuple(methods)) for case in cases]
    found = each(judge_session, calls, workers=workers, what="comparing")
    return MethodComparison(
        tuple(methods),
        tuple(one for judged, _ in found for one in judged),
        tuple(remarks),
        tuple(one for _, sure in found for one in sure),
    )


def run(
    strokes: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[STROKE]...", help="Recorded strokes (.npz), or their folders."),
    ] = None,
    methods: Annotated[
        str, typer.Option(metavar="METHOD,METHOD", help=f"Some of {', '.join(METHODS)}.")
    ] = "published,field",
    seeds: Seeds = 10,
    textures: Textures = None,
    hand: HandKind = "strokes",
    generators: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,MODULE:BUILDER",
            help="Others' generators, judged beside the methods by what all of them render.",
        ),
    ] = None,
    workers: Workers = None,
) -> Findings:
    """Compare methods of texture modelling; the first one named is what the others differ from.

    Raises
    ------
    InputError
        A method, generator, texture or kind of hand is not known.
    """
    names = [name.strip() for name in methods.split(",")]
    others = [name.strip() for name in generators.split(",")] if generators is not None else []
    check_methods(names)
    check_generators(others)
    chosen = chosen_textures(textures)
    recorded, remarks = recorded_cases(strokes or [], chosen)
    cases = [*simulated_cases(seeds, chosen, hand_of(hand).kind), *recorded]
    # First, since a generator may fail.
    rendered = compare_rendered(cases, names, others, workers) if others else None
    return findings(compare(cases, names, remarks, workers), rendered)


def findings(comparison: MethodComparison, rendered: RenderedComparison | None = None) -> Findings:
    """Return a comparison as tables, sentences, and what a report shows."""
    keys = [(name, str(dict(METHODS[name]))) for name in comparison.methods]
    found = Findings(
        TITLE,
        tables=method_tables(comparison),
        sentences=[*verdicts(comparison), *comparison.remarks],
        blocks=lambda: method_blocks(comparison),
        definitions={**DEFINITIONS, **CERTAINTY_DEFINITIONS},
        settings=[Table(("method", "keys of [texture]"), keys)],
        data=comparison.as_dict(),
    )
    return found if rendered is None else _with_rendered(found, rendered)


def _with_rendered(found: Findings, rendered: RenderedComparison) -> Findings:
    """Return the findings with what generators and methods render."""
    blocks = found.blocks or list
    return replace(
        found,
        tables=[*found.tables, *rendered.tables()],
        sentences=[*found.sentences, *rendered.sentences()],
        blocks=lambda: [*blocks(), *rendered.blocks()],
        definitions={**found.definitions, **RENDERED_DEFINITIONS},
        data={**(found.data or {}), "rendered": rendered.as_dict()},
        failures=rendered.failures(),
    )


EXPERIMENT = Experiment(
    shows="which method of texture modelling comes closest to known textures, and how soon",
    duration="40 min on 2 processors",
    run=run,
)
