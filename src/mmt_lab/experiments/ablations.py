"""The field without each of its ingredients, on clean, noisy, drawn, uneven and spoilt sessions.

Every session is modelled by the whole field, and by the field without one ingredient at a time.
The cost of leaving an ingredient out is the difference: in the share of the strokes made whose
level is within one JND (its mean, and the mean of the five worst), in the log-spectral distance, in
the expected share, and in the number of sessions that meet the criteria.
"""

from collections.abc import Sequence
from typing import Annotated, Final

import numpy as np
import typer

from mmt.evaluation.model_errors import WORST
from mmt.evaluation.reports.document import ReportTable
from mmt_lab.compare.ablations import INGREDIENTS
from mmt_lab.compare.cases import INHOMOGENEOUS, ComparisonCase, simulated_cases
from mmt_lab.compare.judging import SHARES, JudgedMethod, judge
from mmt_lab.compare.spoiling import chosen_spoils
from mmt_lab.harness.experiment import Seeds, Textures, Workers, chosen_names, chosen_textures
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import map_in_processes

SHOWS: Final = "what each ingredient of the field is worth, by leaving it out"
TAKES: Final = "10 min on 2 processors for six textures"

WHOLE: Final = "field"

MOMENTS: Final = ("3 s", "10 s", "30 s")

HAND: Final = "quick"

SPOILS: Final = ("quiet-40", "held", "knock", "hum", "lost-2")

DEFINITIONS: Final = {
    "share": "share of the strokes made whose level is within one JND: mean over the sessions, and "
    f"mean of the {WORST} worst; by how much it is smaller without the ingredient",
    "dB": "log-spectral distance (dB): by how much it is larger without the ingredient",
    "off": "expected less true share, mean over the sessions; without the ingredient",
    "start, stop": "how many more or fewer sessions meet the criteria without the ingredient",
}


def sets(
    textures: Sequence[str], seeds: int, spoils: Sequence[str]
) -> dict[str, tuple[list[ComparisonCase], Sequence[str]]]:
    """Return the sets of sessions by name, each with the disturbances that spoil it."""
    drawn = chosen_textures("drawn")
    return {
        "clean": (simulated_cases(seeds, textures, HAND, noise=False), ()),
        "noisy": (simulated_cases(seeds, textures, HAND), ()),
        "drawn": (simulated_cases(seeds, drawn, HAND), ()),
        "uneven": (simulated_cases(seeds, INHOMOGENEOUS, HAND), ()),
        "spoilt": (simulated_cases(seeds, textures, HAND, noise=False), spoils),
    }


def cost_tables(
    name: str, judged: Sequence[JudgedMethod], ingredients: Sequence[str]
) -> list[ReportTable]:
    """Return the costs of leaving out each ingredient on a set of sessions: shares, then others."""
    shares, rest = [], []
    for ingredient in ("", *ingredients):
        method = f"{WHOLE}-{ingredient}" if ingredient else WHOLE
        named = [ingredient or "whole field"]
        costs = [_costs(judged, method, moment) for moment in MOMENTS]
        shares.append(named + [cell for at in costs for cell in at[:2]])
        cells = named + [at[2] for at in costs]
        off = [
            one.expected - one.true
            for one in _of(judged, method, "30 s")
            if one.expected is not None and one.true is not None
        ]
        cells.append(f"{np.mean(off):+.3f}" if off else "-")
        for criterion in ("start", "stop"):
            more = len(_of(judged, method, criterion))
            less = len(_of(judged, WHOLE, criterion)) if ingredient else 0
            cells.append(f"{more - less:+d}" if ingredient else str(more))
        rest.append(cells)
    columns = ["without", *(name for moment in MOMENTS for name in (f"{moment}: share", "worst"))]
    others = ["without", *(f"{moment}: dB" for moment in MOMENTS), "off", "start", "stop"]
    sessions = len(_of(judged, WHOLE, "30 s"))
    return [
        ReportTable(columns, shares, f"{name}, {sessions} sessions: shares"),
        ReportTable(others, rest, f"{name}: spectrum, expected share, criteria"),
    ]


def _of(judged: Sequence[JudgedMethod], method: str, moment: str) -> list[JudgedMethod]:
    return [one for one in judged if (one.method, one.moment) == (method, moment)]


def _costs(judged: Sequence[JudgedMethod], method: str, moment: str) -> list[str]:
    """Return share, worst share and spectrum: values for the whole field, else the losses."""
    own, whole = (_figures(_of(judged, name, moment)) for name in (method, WHOLE))
    if method == WHOLE:
        return [f"{own[0]:.3f}", f"{own[1]:.3f}", f"{own[2]:.2f}"]
    return [f"{whole[0] - own[0]:+.3f}", f"{whole[1] - own[1]:+.3f}", f"{own[2] - whole[2]:+.2f}"]


def _figures(chosen: Sequence[JudgedMethod]) -> tuple[float, float, float]:
    shares = np.sort([one.figures[SHARES[0]] for one in chosen])
    spectra = [o.figures["log_spectral_db"] for o in chosen if "log_spectral_db" in o.figures]
    return float(shares.mean()), float(shares[:WORST].mean()), float(np.mean(spectra))


def run(
    ingredients: Annotated[
        str, typer.Option(metavar="NAME,NAME", help=f"Some of {', '.join(INGREDIENTS)}.")
    ] = ",".join(INGREDIENTS),
    seeds: Seeds = 1,
    textures: Textures = None,
    spoil: Annotated[
        str, typer.Option(metavar="NAME,NAME", help="What spoils sessions; see `compare`.")
    ] = ",".join(SPOILS),
    workers: Workers = None,
) -> Findings:
    """Measure what each ingredient of the field is worth, by leaving it out."""
    names = chosen_names("--ingredients", ingredients, INGREDIENTS)
    spoils = chosen_spoils(spoil)
    methods = (WHOLE, *(f"{WHOLE}-{name}" for name in names))
    chosen = sets(chosen_textures(textures), seeds, spoils)
    calls = [(case, methods, spoilt) for cases, spoilt in chosen.values() for case in cases]
    found = iter(map_in_processes(judge, calls, workers=workers, what="leaving out"))
    judged: dict[str, list[JudgedMethod]] = {}
    for name, (cases, spoilt) in chosen.items():
        every = [one for _ in cases for one in next(found)[0]]
        judged[name] = [one for one in every if bool(one.spoil) == bool(spoilt)]
    tables = [t for name, every in judged.items() for t in cost_tables(name, every, names)]
    words = [(name, INGREDIENTS[name].what) for name in names]
    return Findings(
        "What each ingredient of the field is worth",
        tables=tables,
        definitions=DEFINITIONS,
        settings=[ReportTable(("ingredient", "what is left out"), words)],
        data={"tables": [{"caption": t.caption, "rows": t.rows} for t in tables]},
    )
