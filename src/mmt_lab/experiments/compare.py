"""Methods of texture modelling side by side, on known textures.

Each session is simulated once and modelled by every method. At four times, and when each method's
own criteria are met, the models are compared with the known texture: over the strokes made, and
over the whole plane. Differences from the first method are paired by session, and given with their
standard errors. If a method states its own error, that statement is checked. Sessions may be
spoilt, by disturbed moments and by lost frames.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Annotated, Final

import typer

from mmt.core.errors import InputError
from mmt.evaluation.model_errors import BAND_EDGES_HZ, WORST
from mmt.evaluation.reports.document import Block, Heading, ReportTable
from mmt.evaluation.reports.report_files import picture
from mmt_lab.compare.cases import INHOMOGENEOUS, ComparisonCase, simulated_cases
from mmt_lab.compare.generators import DEFINITIONS as OF_GENERATORS
from mmt_lab.compare.generators import (
    check_generators,
    failures,
    generator_sentences,
    generators_table,
    judge_generators,
)
from mmt_lab.compare.judging import METHODS, SHARES, TIMES_S, chosen_methods, judge
from mmt_lab.compare.spoiling import SPOILS, chosen_spoils
from mmt_lab.compare.summary import RUN_TO_RUN_DB, STANDARD_ERRORS, MethodComparison
from mmt_lab.compare.tables import (
    calibration_figure,
    calibration_table,
    difference_sentences,
    errors_table,
    falls_table,
    largest_miscalibration,
    rates_table,
    shares_table,
)
from mmt_lab.harness.experiment import (
    AccelerationRates,
    HandKind,
    Seeds,
    Textures,
    Workers,
    chosen_textures,
    hand_of,
    names_of,
    rates_of,
)
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.harness.processes import map_in_processes

SHOWS: Final = "which method of texture modelling comes closest to known textures, and how soon"
TAKES: Final = "40 min on 2 processors"

DEFINITIONS: Final = {
    "within_jnd, plane_within_jnd": "share of the strokes that were made, or of the plane, whose "
    "level is within one JND, 1.36 dB, of the known texture's, from 8 Hz up",
    "power_error_db, plane_power_error_db": "root mean square of that level's error, dB",
    "rate": "of the acceleration; sessions of different rates are counted apart, and what is above "
    "1 kHz counts in the errors by bands and not for the level",
    "gfc": "goodness of fit between expected Welch amplitude spectra, mean over the strokes made",
    "log_spectral_db": "log-spectral distance from 10 Hz to half the rate, mean over the strokes, "
    "dB",
    "band_error_db": "root mean square over the strokes made and all bands of the error of a "
    "band's power, dB; up to 500 Hz the bands have edges at "
    + ", ".join(f"{edge:.0f}" for edge in BAND_EDGES_HZ)
    + " Hz, and go on by the same ratio",
    "strokes made": "up to 400 moments, evenly spread over the session's time of stroking, with at "
    "least 10 mm/s and 0.1 N; of the session before it was spoilt",
    "plane": "the middles of 12 x 12 equal cells from 10 to 300 mm/s and 0.1 to 3 N; 6 x 6 at 24 "
    "headings where they count",
    "run to run": "how the level of a band scatters between slides over one real material, "
    f"root mean square over the bands {RUN_TO_RUN_DB:.2f} dB",
    "moments": "times of the session, and the start and stop of each method's own criterion. "
    "Sessions that do not come to a moment are not counted at it; without a model a share is 0",
    "worst": f"mean of the {WORST} worst sessions",
    "difference": "mean over sessions of a method less the first, with its standard error; better "
    f"or worse where it exceeds {STANDARD_ERRORS:g} of them",
    "expected share": "what a method states, beside the true share of strokes like those so far "
    "and, for 10 s of stroking, like the whole plane",
    "standardised error": "error of the level over the strokes made, each over its predicted "
    "standard deviation, root mean square",
}


def method_tables(comparison: MethodComparison) -> list[ReportTable]:
    """Return tables of shares and errors by group, of falls, of rates, and of expected shares."""
    tables = []
    for group in comparison.groups:
        tables += [shares_table(comparison, group), errors_table(comparison, group)]
    if comparison.spoils:
        tables.append(falls_table(comparison))
    if comparison.several_rates:
        tables.append(rates_table(comparison))
    return tables + [calibration_table(comparison, method) for method in comparison.sure]


def method_blocks(comparison: MethodComparison) -> list[Block]:
    """Return the tables, and pictures of expected against true shares, for a report."""
    blocks: list[Block] = [*method_tables(comparison)]
    for method, sure in comparison.sure.items():
        caption = f"{method}: each update of each session; means of tenths; grey: where they agree."
        blocks.append(picture(f"calibration-{method}", caption, calibration_figure(sure)))
    return blocks


def targets(comparison: MethodComparison) -> list[Target]:
    """Return the targets of each method but the first, in each group and if spoilt."""
    found = []
    first = comparison.methods[0]
    # without generators, which may not have reached every time
    alone = [name for name in comparison.methods if name.partition("-")[0] in METHODS]
    for group in comparison.groups:
        rows = {(row.moment, row.method): row for row in comparison.rows(group)}
        for method in alone[1:]:
            leads = []
            for moment in (f"{time_s:g} s" for time_s in TIMES_S):
                own, other = (rows[moment, name].figures[SHARES[0]] for name in (method, first))
                leads += [own.mean - other.mean, own.worst - other.worst]
            what = f"{group}: share of {method} less that of {first}, the least of mean and worst"
            found.append(Target(what, min(leads), "at least", 0.0))
    for fall in comparison.falls():
        if fall.method != first and fall.figure == SHARES[0]:
            what = f"{fall.method}, spoilt by {fall.spoil}: fall of the share, "
            bound = LARGEST_FALLS.get(fall.spoil.removesuffix("-in-threes"), LARGEST_FALL)
            found.append(Target(f"{what}mean", fall.mean, "at most", bound))
    for method, sure in comparison.sure.items():
        off = largest_miscalibration(sure)
        what = f"{method}: expected less true share, largest in a tenth of the expected share"
        found.append(Target(what, off, "at most", 0.05))
    return found


LARGEST_FALL: Final = 0.01
LARGEST_FALLS: Final = {"lost-1": 0.01, "lost-2": 0.02, "lost-5": 0.05}


def run(
    methods: Annotated[
        str, typer.Option(metavar="METHOD,METHOD", help=f"Some of {', '.join(METHODS)}.")
    ] = ",".join(METHODS),
    seeds: Seeds = 10,
    textures: Textures = None,
    hand: HandKind = "strokes",
    noise_free: Annotated[
        bool, typer.Option("--noise-free", help="Sensors without noise and resolution.")
    ] = False,
    spoil: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help=f"Spoil each session too: all, or {', '.join(SPOILS)}.",
        ),
    ] = None,
    acceleration_rate: AccelerationRates = "1000",
    generators: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,MODULE:BUILDER",
            help="Others' generators, judged beside the methods by what they render.",
        ),
    ] = None,
    workers: Workers = None,
) -> Findings:
    """Compare methods of texture modelling, each with the first one named."""
    names, others, spoils = chosen_methods(methods), names_of(generators), chosen_spoils(spoil)
    check_generators(others)
    chosen = chosen_textures(textures) + ([] if textures else list(INHOMOGENEOUS))
    made = simulated_cases(seeds, chosen, hand_of(hand).kind, noise=not noise_free)
    rates = rates_of(acceleration_rate)
    if others and rates != [1000]:
        raise InputError("--generators: they render at 1 kHz; leave --acceleration-rate out")
    cases = [replace(case, acceleration_rate_hz=rate_hz) for rate_hz in rates for case in made]
    found = _judged(cases, names, spoils, workers)
    return _with_generators(found, cases, others, workers) if others else findings(found)


def _judged(
    cases: Sequence[ComparisonCase],
    methods: Sequence[str],
    spoils: Sequence[str],
    workers: int | None,
) -> MethodComparison:
    passes = [(case, methods, spoils) for case in cases]
    judged = map_in_processes(judge, passes, workers=workers, what="comparing")
    return MethodComparison(
        tuple(methods),
        tuple(one for by_method, _ in judged for one in by_method),
        tuple(one for _, sure in judged for one in sure),
    )


def findings(comparison: MethodComparison) -> Findings:
    """Return a comparison as findings."""
    sentences = [
        sentence
        for method in comparison.methods[1:]
        for sentence in difference_sentences(comparison, method)
    ]
    return Findings(
        "Methods side by side",
        tables=method_tables(comparison),
        sentences=sentences,
        blocks=lambda: method_blocks(comparison),
        definitions=DEFINITIONS,
        targets=tuple(targets(comparison)),
        data=comparison.as_dict(),
    )


def _with_generators(
    comparison: MethodComparison,
    cases: Sequence[ComparisonCase],
    names: Sequence[str],
    workers: int | None,
) -> Findings:
    """Judge generators on the same cases; return the findings on them beside the methods."""
    calls = [(case, names) for case in cases]
    every = map_in_processes(judge_generators, calls, workers=workers, what="rendering")
    rendered = [one for by_session, _ in every for one in by_session]
    faults = [one for _, of in every for one in of]
    judged = (*comparison.judged, *(one.judged for one in rendered))
    methods = (*comparison.methods, *names)
    found = findings(replace(comparison, methods=methods, judged=judged))
    table, blocks = generators_table(rendered), found.blocks or list
    return replace(
        found,
        tables=[*found.tables, table],
        sentences=[*found.sentences, *generator_sentences(rendered)],
        blocks=lambda: [*blocks(), Heading("Generators"), table],
        definitions={**found.definitions, **OF_GENERATORS},
        data={
            **(found.data or {}),
            "generators": [asdict(one) for one in rendered],
            "faults": [asdict(one) for one in faults],
        },
        failures=failures(faults),
    )
