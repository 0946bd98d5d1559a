"""Sessions over several known surfaces: how soon a change is found, and how many are missed.

The tool goes over 2 to 6 textures in random order; half of the changes fall on a lift-off. Two
groups are simulated: textures that are the same in all directions, and some that depend on the
heading. Recorded sessions with a known course are scored likewise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from scipy.stats import chi2

from mmt.core.errors import InputError
from mmt.evaluation.model_errors import BAND_EDGES_HZ
from mmt.evaluation.reports.document import ReportTable, table_of
from mmt_lab.harness.experiment import (
    HandKind,
    Seed,
    Seeds,
    Textures,
    Workers,
    chosen_textures,
    hand_of,
)
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.harness.processes import map_in_processes
from mmt_lab.surfaces.running import RECORDED, STAY_S, SurfaceResult, run_recorded, run_simulated
from mmt_lab.surfaces.slides import SLIDES, run_slides, scatter_db

SHOWS: Final = "how soon a change of surface is found, and how many are missed"
TAKES: Final = "10 min on 2 processors"

TARGETS: Final = {"delay_s": 1.0, "missed": 0.15, "false_alarms_per_hour": 6.0}

CAPTIONS: Final = {
    "isotropic": "Textures that are the same in all directions",
    "grained": "Some of the textures depend on the heading, on which the hand keeps changing",
    RECORDED: "Recorded sessions",
    SLIDES: "Recorded slides over real materials",
}

DEFINITIONS: Final = {
    "stays": "stays on a surface but for the first one of each session, and without those of "
    "under 0.3 s of stroking in which nothing was found",
    "delay_s": "from the first contact with the other surface until the leader knows that it is "
    "another one, filters and the leader's period included; _p90: 90th percentile",
    "within_target": "share of the stays that were found within 1 s",
    "missed": "stays in which nothing was found; _share: of all stays",
    "false_alarms": "changes that were found while the tool stayed; in stroked_s of stroking. A "
    "change counts for the stay that most of the samples are of from which it was found, or for "
    "the next where vibration of that one was received and this one had its own model before",
    "false_alarms_per_hour_most": "this many an hour are still possible (95 %, one-sided)",
}


def groups(results: Sequence[SurfaceResult]) -> dict[str, list[dict[str, Any]]]:
    """Return the figures of each group by number of surfaces, and over all its sessions last."""
    found = {}
    for group in dict.fromkeys(result.group for result in results):
        parts: dict[str, list[SurfaceResult]] = {}
        of_group = [result for result in results if result.group == group]
        for result in sorted(of_group, key=lambda each: len(each.surfaces)):
            parts.setdefault(str(len(result.surfaces)), []).append(result)
        parts["all"] = of_group
        found[group] = [{"group": group, **_figures(*part)} for part in parts.items()]
    return found


def changes_table(group: str, rows: Sequence[Mapping[str, Any]]) -> ReportTable:
    """Return a row for each number of surfaces of a group."""
    cells = [
        {
            "surfaces": row["surfaces"],
            "sessions": str(row["sessions"]),
            "stays": str(row["stays"]),
            "delay (s)": _blank(row["delay_s"], ".2f"),
            "delay p90 (s)": _blank(row["delay_p90_s"], ".2f"),
            "in 1 s": _blank(row["within_target"], ".1%"),
            "missed": str(row["missed"]),
            "false alarms": str(row["false_alarms"]),
            "stroked (min)": f"{row['stroked_s'] / 60.0:.0f}",
        }
        for row in rows
    ]
    return table_of(cells, f"{CAPTIONS[group]}. Delays are medians.")


def scatter_table(folder: Path) -> ReportTable:
    """Return the scatter of the level between recorded slides, a column for each band."""
    edges = [f"{edge:.0f}" for edge in BAND_EDGES_HZ]
    columns = ["dB", *(f"{low}-{high} Hz" for low, high in pairwise(edges))]
    within, between = ([f"{value:.2f}" for value in row] for row in scatter_db(folder))
    rows = [["from slide to slide", *within], ["between materials", *between]]
    return ReportTable(columns, rows, caption="Levels of whole slides: standard deviations.")


def remarks(overall: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the figures over each group in a sentence."""
    return [
        f"{row['group']}: {row['false_alarms_per_hour']:.1f} false alarms an hour of stroking, "
        f"up to {row['false_alarms_per_hour_most']:.1f} possible; {row['missed']} of "
        f"{row['stays']} changes missed"
        + ("" if row["delay_s"] is None else f", the others found after {row['delay_s']:.2f} s")
        for row in overall
        if row["false_alarms_per_hour_most"] is not None
    ]


def targets(overall: Sequence[Mapping[str, Any]]) -> tuple[Target, ...]:
    """Return the targets of each group."""
    return tuple(
        Target(f"{row['group']}: {what}", row[key], "at most", TARGETS[target])
        for row in overall
        for what, key, target in (
            ("median delay (s)", "delay_s", "delay_s"),
            ("missed", "missed_share", "missed"),
            ("false alarms an hour", "false_alarms_per_hour", "false_alarms_per_hour"),
        )
    )


def _figures(name: str, group: Sequence[SurfaceResult]) -> dict[str, Any]:
    scores = [result.score for result in group]
    stays = [delay_s for each in scores for delay_s in each.delays_s]
    delays = [delay_s for delay_s in stays if delay_s is not None]
    missed = len(stays) - len(delays)
    stroked_s = sum(each.stroked_s for each in scores)
    false = sum(each.false_alarms for each in scores)
    bound = float(0.5 * chi2.ppf(0.95, 2 * (false + 1)))  # 95 %, one-sided (Garwood 1936)
    in_time = sum(delay <= TARGETS["delay_s"] for delay in delays)
    return {
        "surfaces": name,
        "sessions": len(group),
        "stays": len(stays),
        "delay_s": _quantile(delays, 0.5),
        "delay_p90_s": _quantile(delays, 0.9),
        "within_target": in_time / len(stays) if stays else None,
        "missed": missed,
        "missed_share": missed / len(stays) if stays else None,
        "false_alarms": false,
        "false_alarms_per_hour": 3600.0 * false / stroked_s if stroked_s else 0.0,
        "false_alarms_per_hour_most": bound / (stroked_s / 3600.0) if stroked_s else None,
        "stroked_s": round(stroked_s, 1),
    }


def _quantile(values: Sequence[float], share: float) -> float | None:
    return float(np.quantile(values, share)) if values else None


def _blank(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def run(
    sessions: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[SESSION]...", help="Recorded sessions over known surfaces."),
    ] = None,
    seeds: Seeds = 2,
    seed: Seed = 0,
    textures: Textures = None,
    hand: HandKind = "strokes",
    stay: Annotated[float, typer.Option(min=1, help="Mean seconds on a surface.")] = STAY_S,
    slides: Annotated[
        Path | None, typer.Option(help="Folder of recorded slides over real materials.")
    ] = None,
    workers: Workers = None,
) -> Findings:
    """Measure how soon changes of surface are found, and how many are missed."""
    tables: list[ReportTable] = []
    if slides is not None:
        if sessions or textures is not None:
            raise InputError("--slides takes the place of SESSION and --textures: name one of them")
        tables.append(scatter_table(slides))
        results = run_slides(slides, seeds, first=seed, workers=workers)
    elif sessions:
        results = map_in_processes(
            run_recorded, [(path,) for path in sessions], workers=workers, what="sessions"
        )
    else:
        results = run_simulated(
            seeds,
            first=seed,
            textures=chosen_textures(textures),
            hand=hand_of(hand).kind,
            stay_s=stay,
            workers=workers,
        )
    return _findings(results, tables)


def _findings(results: Sequence[SurfaceResult], tables: Sequence[ReportTable]) -> Findings:
    """Return the scores of sessions as findings, with further tables."""
    found = groups(results)
    overall = [rows[-1] for rows in found.values()]
    return Findings(
        "More than one surface",
        tables=[*(changes_table(group, rows) for group, rows in found.items()), *tables],
        sentences=remarks(overall),
        targets=targets(overall),
        definitions=DEFINITIONS,
        data={
            "rows": [row for rows in found.values() for row in rows],
            "sessions": [asdict(result) for result in results],
        },
    )
