"""The tables and sentences of a report."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from mmt.core.output.tables import as_text, flatten, label
from mmt.evaluation.model_errors import SECTOR_DEG, WORST, SectorErrors, across
from mmt.evaluation.reports.document import Block, Heading, ReportTable, SideBySide, table_of
from mmt.evaluation.results import Evaluation, Levels, Score
from mmt.evaluation.texts import number, seconds, share


def overview(evaluations: Sequence[Evaluation]) -> ReportTable:
    """Return one row for each session: when it was complete, and the spectra's shape then."""
    rows = []
    for evaluation in evaluations:
        final = evaluation.final
        mean_ms, longest_ms = evaluation.update_ms or (None, None)
        rows.append(
            {
                "session": evaluation.name,
                "against": evaluation.surface or "held-out",
                "start (s)": seconds(evaluation.start_s),
                "stop (s)": seconds(evaluation.stop_s),
                "samples": str(final.samples),
                "GFC": number(final.gfc, 3),
                "ceiling": number(final.gfc_ceiling, 3),
                "truth GFC": number(final.truth_gfc, 3),
                "spectrum (dB)": number(final.truth_log_spectral_db, 2),
                "update (ms)": number(mean_ms, 1),
                "at most (ms)": number(longest_ms, 1),
            }
        )
    return table_of(rows, f"{_FINAL} Updates: mean and longest of those of the steps.")


_FINAL: Final = "Figures at the stop criterion, or at the end where it was never met."


def levels(evaluations: Sequence[Evaluation]) -> ReportTable:
    """Return the error of the level by each method, and its statistics across several sessions."""
    named: dict[str, list[Levels | Score]] = {}
    rows = []
    for evaluation in evaluations:
        final = evaluation.final
        own: tuple[str, Levels | Score] = (evaluation.settings.method, final)
        for method, found in (own, (evaluation.beside, final.beside)):
            named.setdefault(method, []).append(found)
            figures = (getattr(found, name) for name in _LEVELS)
            rows.append((evaluation.name, method, *map(_level_cell, _LEVELS, figures)))
    if len(evaluations) > 1:
        for method, every in named.items():
            rows += _across(method, every)
    caption = (
        f"{_FINAL} Error of the level (root mean square) and share within one just noticeable "
        "difference, 1.36 dB, over the strokes that were made and over the whole plane, against "
        "the known texture. Without one: over the strokes of the held-out segments, against these."
    )
    return ReportTable(("session", "method", *_LEVELS.values()), rows, caption)


_LEVELS: Final = {
    "power_error_db": "error (dB), strokes made",
    "within_jnd": "within JND, strokes made",
    "plane_power_error_db": "error (dB), whole plane",
    "plane_within_jnd": "within JND, whole plane",
}
"""Titles of the figures of `Levels`."""


def _level_cell(name: str, value: float | None) -> str:
    return share(value) if name.endswith("jnd") else number(value, 2)


def _across(method: str, every: Sequence[Levels | Score]) -> list[tuple[str, ...]]:
    """Return the rows of one method across sessions."""
    titles = ("median", "mean", f"mean of the {WORST} worst", "sessions below 50 %")
    columns: list[Sequence[str]] = []
    for name in _LEVELS:
        values = [value for one in every if (value := getattr(one, name)) is not None]
        is_share = name.endswith("jnd")
        if not values:
            columns.append("-" * len(titles))
            continue
        found = across(values, larger_is_better=is_share)
        cells = [_level_cell(name, value) for value in (found.median, found.mean, found.worst)]
        columns.append([*cells, str(found.below_half) if is_share else "-"])
    return [(title, method, *row) for title, *row in zip(titles, *columns, strict=True)]


def by_time(evaluations: Sequence[Evaluation], name: str, digits: int, caption: str) -> ReportTable:
    """Return paper A's Table I for one figure: a row a session, a column a step."""
    times = sorted({step.time_s for evaluation in evaluations for step in evaluation.steps})
    rows = []
    for evaluation in evaluations:
        at = {step.time_s: getattr(step, name) for step in evaluation.steps}
        rows.append((evaluation.name, *(number(at.get(time_s), digits) for time_s in times)))
    return ReportTable(("session", *(f"{time_s:g} s" for time_s in times)), rows, caption)


def account(evaluation: Evaluation) -> str:
    """Describe the evaluated session and the reference."""
    state = "" if evaluation.complete else " (cut off and mended)"
    lost = evaluation.missing_frames
    settings = evaluation.settings
    against = "is measured against" if evaluation.basis == "truth" else "has no known texture:"
    return (
        f"{evaluation.duration_s:.1f} s{state}, {lost} frames missing; AR order "
        f"{evaluation.order}, method {settings.method}, an "
        f"update every {evaluation.period_s:g} s. The model {against} {evaluation.basis_reason}. "
        f"Start criterion: {_met(evaluation.start_s)}; stop criterion: {_met(evaluation.stop_s)}. "
        f"Evaluated in {evaluation.processing_s:.2f} s, {evaluation.times_real_time:.0f} times "
        f"faster than real time."
    )


def _met(time_s: float | None) -> str:
    return "never met" if time_s is None else f"met at {time_s:.1f} s"


def control(evaluation: Evaluation) -> ReportTable:
    """Return a row for each period in which one hand, or none, moved the robot."""
    rows = [
        {
            "hand that moved the robot": period.hand,
            "from (s)": number(period.from_s, 2),
            "to (s)": number(period.to_s, 2),
        }
        for period in evaluation.control
    ]
    return table_of(rows)


def moments(evaluation: Evaluation) -> ReportTable:
    """Return the figures at the start criterion, at the stop criterion and at the end."""
    scores = {"start": evaluation.at_start, "stop": evaluation.at_stop, "end": evaluation.at_end}
    rows = [{"at": name, **_cells(score)} for name, score in scores.items() if score is not None]
    return table_of(rows)


def steps(evaluation: Evaluation) -> ReportTable:
    """Return the figures at every step; a short session has none."""
    rows = [list(_cells(step).values()) for step in evaluation.steps]
    return ReportTable(list(_cells(evaluation.at_end)), rows)


def _cells(score: Score) -> dict[str, str]:
    return {
        "time (s)": number(score.time_s, 1),
        "samples": str(score.samples),
        "distance": number(score.distance, 2),
        "update (ms)": number(score.update_ms, 1),
        "GFC": number(score.gfc, 3),
        "ceiling": number(score.gfc_ceiling, 3),
        "truth GFC": number(score.truth_gfc, 3),
        "error (dB), made": number(score.power_error_db, 2),
        "within JND, made": share(score.within_jnd),
        "within JND, plane": share(score.plane_within_jnd),
        "held-out error (dB)": number(score.held_out_power_error_db, 2),
    }


def held_out(evaluation: Evaluation) -> ReportTable:
    """Return one row for each held-out segment."""
    rows = [
        {
            "from (s)": number(segment.start_s, 3),
            "to (s)": number(segment.stop_s, 3),
            "speed (mm/s)": number(segment.speed_mm_s, 1),
            "force (N)": number(segment.force_n, 2),
            "GFC": number(segment.gfc, 3),
            "power error (dB)": number(segment.power_error_db, 2),
        }
        for segment in evaluation.held_out
    ]
    return table_of(rows, "Held-out segments")


def bands(evaluation: Evaluation) -> ReportTable:
    """Return the error in each band of frequency."""
    rows = [
        (f"{band.low_hz:.0f} to {band.high_hz:.0f}", number(band.error_db, 2))
        for band in evaluation.bands
    ]
    return ReportTable(("band (Hz)", "power error (dB)"), rows, "Error by bands")


def worst_table(evaluation: Evaluation) -> ReportTable:
    """Return where the model is farthest from the known texture, and why."""
    rows = [
        {
            "worst in": point.measure,
            "speed (mm/s)": number(point.speed_mm_s, 0),
            "heading": number(point.heading_deg, 0),
            "force (N)": number(point.force_n, 2),
            "power error (dB)": number(point.power_error_db, 2),
            "GFC": number(point.gfc, 3),
            "limit": point.limit,
            "why": point.reason,
        }
        for point in evaluation.worst
    ]
    return table_of(rows, "Where the model is farthest from the known texture")


_BY_HEADING = (
    f"Against the known texture by heading, in sectors of {SECTOR_DEG:g} degrees about the "
    "heading given: GFC, log-spectral distance (LSD, dB) and power error (dB rms) of the model, "
    "and of the texture's own mean over all headings, which a model that does not know the heading "
    "reaches at best."
)


def by_heading(evaluation: Evaluation) -> ReportTable:
    """Return one row for each sector and one over all, three columns for each model."""
    columns = ["toward"]
    for errors in evaluation.by_heading:
        columns += [f"{errors.model} {what}" for what in ("GFC", "LSD", "power")]
    whole = [errors.overall for errors in evaluation.by_heading]
    sectors = zip(*(errors.sectors for errors in evaluation.by_heading), strict=True)
    rows = [_errors(f"{row[0].heading_deg:.0f}", row) for row in sectors]
    return ReportTable(columns, [*rows, _errors("all", whole)], _BY_HEADING)


def heading_tables(evaluations: Sequence[Evaluation]) -> list[ReportTable]:
    """Return a table by heading for each session on a texture that depends on it."""
    return [by_heading(each) for each in evaluations if each.by_heading]


def _errors(heading: str, models: Sequence[SectorErrors]) -> list[str]:
    cells = [heading]
    for errors in models:
        cells += [
            number(errors.gfc, 3),
            number(errors.log_spectral_db, 1),
            number(errors.power_error_db, 1),
        ]
    return cells


def run_blocks(run: Mapping[str, object]) -> list[Block]:
    """Return a section for each table of a run; lists of tables inside become tables."""
    single = {name: value for name, value in run.items() if not isinstance(value, Mapping)}
    blocks: list[Block] = [*_group("", single)]
    for name, content in run.items():
        if not isinstance(content, Mapping):
            continue
        title = label(name)
        blocks.append(Heading(title[:1].upper() + title[1:], 3))
        found = _group("", {n: v for n, v in content.items() if not isinstance(v, Mapping)})
        for inner, table in content.items():
            if isinstance(table, Mapping):
                found += _group(label(inner), table)
        blocks.append(SideBySide(found))
    return blocks


def _group(caption: str, content: Mapping[str, Any]) -> list[ReportTable]:
    """Return one table of single values, and one for each list of tables, however deep."""
    flat = flatten(content)
    pairs = {name: value for name, value in flat.items() if not _is_rows(value)}
    tables = [_pairs(pairs, caption)] if pairs else []
    for name, value in flat.items():
        if _is_rows(value):
            tables.append(_rows(value, f"{caption}, {name}" if caption else name))
    return tables


def _is_rows(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _pairs(content: Mapping[str, object], caption: str = "") -> ReportTable:
    rows = [(name, as_text(value)) for name, value in content.items()]
    return ReportTable(("figure", "value"), rows, caption)


def _rows(content: Sequence[Mapping[str, object]], caption: str) -> ReportTable:
    names = list(dict.fromkeys(name for row in content for name in row))
    rows = [tuple(as_text(row.get(name)) for name in names) for row in content]
    return ReportTable(tuple(label(name) for name in names), rows, caption)
