"""The report of a run or of an evaluation: Markdown, HTML, figures and JSON in one folder."""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from mmt.core.extras import __version__
from mmt.evaluation.reports import tables
from mmt.evaluation.reports.document import (
    Block,
    Folded,
    Heading,
    Listing,
    Paragraph,
    ReportTable,
    Tile,
    Tiles,
)
from mmt.evaluation.reports.report_files import picture, write_report_files
from mmt.evaluation.results import Evaluation, evaluations_as_dict
from mmt.evaluation.run_verdict import median_of_known, run_verdict
from mmt.evaluation.texts import DEFINITIONS, share

_COMPLETION: Final = {
    "distance": "Completion: the distance sum after each update, and both thresholds.",
    "uncertainty": "Completion: after each update, the share of the operator's strokes whose level "
    "is expected to be within one JND, and both thresholds.",
}

_GROWTH: Final = {
    "isotropic": (
        "The model as it grows: samples (dark), boundary points (white), triangulation, and "
        "the nine cells in the shade of their distance to the three nearest samples."
    ),
    "anisotropic": (
        "The model as it grows, seen along the force: samples in the colour of their force, the "
        "largest speed (circle), and the cells in the shade of their distance to the four "
        "nearest samples, its mean over forces."
    ),
}

_PACKAGES: Final = ("numpy", "scipy", "numba", "matplotlib")


def write_report(
    directory: Path,
    evaluations: Sequence[Evaluation],
    *,
    title: str = "Evaluation",
    scene: Mapping[str, Any] | None = None,
    run: Mapping[str, object] | None = None,
    more: Sequence[Block] = (),
) -> Path:
    """Write the report of evaluations, of a run or both, with the data ``summary.json``.

    Directory, result and errors are those of `write_report_files`.

    Parameters
    ----------
    evaluations
        May be empty if only a run is reported.
    title
        Title of the report.
    scene
        The resolved scene as tables.
    run
        Summaries of the services, as nested tables: one section for each key.
    more
        Further blocks, after the overview.
    """
    made, figures = datetime.now(UTC), evaluations_as_dict(evaluations)
    blocks: list[Block] = [Heading(title, 1), Paragraph(f"{made:%Y-%m-%d, %H:%M} UTC")]
    blocks += _at_a_glance(evaluations, figures, run or {})
    # figures of a single session are not named after it, so that those of two reports match
    alone = len(evaluations) == 1
    prefixes = [
        "" if alone else f"{place + 1}-{_file_name(each.name)}-"
        for place, each in enumerate(evaluations)
    ]
    if alone:
        blocks += _errors(evaluations[0], "")
    if evaluations:
        blocks += _course(evaluations)
    blocks += more
    for prefix, evaluation in zip(prefixes, evaluations, strict=True):
        blocks += _session(evaluation, prefix, alone=alone)
    if run:
        blocks.append(Folded("Counters of the run", tables.run_blocks(run)))
    blocks += _appendix(scene, with_scores=bool(evaluations))
    summary = {**figures, "environment": environment()}
    summary |= {"scene": scene} if scene is not None else {}
    summary |= {"run": run} if run is not None else {}
    return write_report_files(directory, title, blocks, "summary.json", summary)


def _at_a_glance(
    evaluations: Sequence[Evaluation], figures: Mapping[str, Any], run: Mapping[str, Any]
) -> list[Block]:
    """Return the first blocks of a report; of several sessions the medians.

    `figures` are those of the evaluations, as `evaluations_as_dict` gives them.
    """
    services = {name: run[name] for name in ("leader", "follower") if name in run}
    found = run_verdict(services, figures)
    first, *others = found.faults or ("all well",)
    tiles = [
        Tile("vibration", found.now),
        Tile("readiness", found.readiness),
        Tile("error of the level", found.error, found.noticeable),
        Tile("health", first, "; ".join(others), "" if found.state == "running" else found.state),
    ]
    blocks: list[Block] = [Tiles([tile for tile in tiles if tile.value])]
    return [*blocks, Paragraph(_on_level(evaluations))] if evaluations else blocks


def _on_level(evaluations: Sequence[Evaluation]) -> str:
    """Return a sentence on the sessions with a known texture, and one on those without."""
    sentences = []
    for basis in dict.fromkeys(evaluation.basis for evaluation in evaluations):
        finals = [evaluation.final for evaluation in evaluations if evaluation.basis == basis]
        known = basis == "truth"
        reference = "known texture" if known else "held-out segments"
        right = median_of_known(final.within_jnd for final in finals)
        if right is None:
            sentences.append(f"There is no model to compare with the {reference}.")
            continue
        plane = median_of_known(final.plane_within_jnd for final in finals)
        sentences.append(
            f"Against the {reference} the level is right, within one just noticeable difference, "
            f"on {share(right)} of {'the strokes that were made' if known else 'their strokes'}"
            + (f", and on {share(plane)} of the whole plane." if known else ".")
        )
    return " ".join(sentences)


def environment() -> dict[str, str]:
    """Return the versions and the machine that figures were computed with."""
    versions = {"mmt": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    machine = f"{platform.system()} {platform.release()}, {platform.machine()}"
    return {**versions, "machine": machine, "processors": str(os.cpu_count() or "unknown")}


def machine_table() -> dict[str, str]:
    """Return what the figures were measured on: processor, load, system and versions."""
    known = hasattr(os, "getloadavg")
    load = ", ".join(f"{value:.2f}" for value in os.getloadavg()) if known else "unknown"
    return {"processor": _processor(), "load (1, 5, 15 min)": load, **environment()}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            return value.strip()
    return platform.processor() or "unknown"


def _course(evaluations: Sequence[Evaluation]) -> list[Block]:
    """Return blocks with the figures of all sessions, and their course over time."""
    from mmt.evaluation.reports import figures

    by_time = [tables.by_time(evaluations, "distance", 2, "Distance sum (paper A, Table I)")]
    if expects := [e for e in evaluations if e.settings.scale.rises]:
        by_time.append(tables.by_time(expects, "completion", 2, "Expected share"))
    criteria = dict.fromkeys(e.settings.scale.criterion for e in evaluations)
    caption = " ".join(_COMPLETION[criterion] for criterion in criteria)
    drawn = [picture("distance", caption, figures.completion_over_time(evaluations))]
    if any(step.power_error_db is not None for e in evaluations for step in e.steps):
        drawn.append(
            picture(
                "power_error",
                "Power error, which GFC ignores; dashed: the just noticeable difference.",
                figures.power_error_over_time(evaluations),
            )
        )
    if any(step.gfc is not None for e in evaluations for step in e.steps):
        by_time.append(tables.by_time(evaluations, "gfc", 3, "GFC of the held-out segments"))
        drawn.append(
            picture(
                "gfc",
                "GFC of the held-out segments; dotted: what the model scores against itself; "
                "dashed: 0.9.",
                figures.gfc_over_time(evaluations),
            )
        )
    overview = [tables.overview(evaluations), tables.levels(evaluations)]
    return [
        *([] if len(evaluations) == 1 else overview),
        Heading("Course"),
        *drawn,
        Folded("Figures by time", [*(overview if len(evaluations) == 1 else []), *by_time]),
    ]


def _errors(evaluation: Evaluation, prefix: str) -> list[Block]:
    """Return the map of errors; nothing if the texture is not known."""
    if evaluation.power_map is None:
        return []
    from mmt.evaluation.reports import figures

    caption = (
        f"The model at {evaluation.final.time_s:.1f} s against the known texture; dots: "
        "samples; circles: the worst points."
    )
    return [
        picture(f"{prefix}errors", caption, figures.power_error_map(evaluation)),
        tables.worst_table(evaluation),
    ]


def _session(evaluation: Evaluation, prefix: str, *, alone: bool) -> list[Block]:
    from mmt.evaluation.reports import figures
    from mmt.evaluation.reports.growth import model_growth

    final_s = evaluation.final.time_s
    blocks: list[Block] = [
        Heading(f"Session {evaluation.name}"),
        Paragraph(tables.account(evaluation)),
        Paragraph(evaluation.remark),
        *([tables.control(evaluation)] if evaluation.control else []),
        *([] if alone else _errors(evaluation, prefix)),
        picture(f"{prefix}model", _GROWTH[evaluation.settings.inputs], model_growth(evaluation)),
    ]
    if evaluation.held_out:
        blocks.append(
            picture(
                f"{prefix}spectra",
                "Held-out segments: measured, and synthesized by the model rebuilt without "
                f"them, at {final_s:.1f} s.",
                figures.held_out_spectra(evaluation),
            )
        )
    if evaluation.by_heading:
        caption = f"Errors against the known texture by heading, at {final_s:.1f} s."
        drawn = figures.errors_by_heading(evaluation)
        blocks += [picture(f"{prefix}headings", caption, drawn), tables.by_heading(evaluation)]
    details = [tables.moments(evaluation), tables.steps(evaluation)]
    details += [tables.bands(evaluation)] * bool(evaluation.bands)
    details += [tables.held_out(evaluation)] * bool(evaluation.held_out)
    return [*blocks, Folded("Every step", details)]


def _appendix(scene: Mapping[str, Any] | None, *, with_scores: bool) -> list[Block]:
    versions = ReportTable(("part", "version"), list(environment().items()))
    scores = ReportTable(("score", "definition"), list(DEFINITIONS.items()))
    blocks: list[Block] = []
    if with_scores:
        blocks.append(Folded("How the scores are defined", [scores]))
    blocks.append(Folded("Made with", [versions]))
    if scene is not None:
        blocks.append(Listing("The resolved scene", json.dumps(scene, indent=2, default=str)))
    return blocks


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)[:48]
