"""Tables and sentences of a comparison of methods."""

from itertools import pairwise
from typing import Final

from mmt.evaluation.document import Table
from mmt.evaluation.levels import BAND_EDGES_HZ
from mmt.evaluation.texts import number
from mmt_lab.compare.judging import FIGURES, MOMENTS
from mmt_lab.compare.summary import (
    ALL_RUN_TO_RUN_DB,
    RUN_TO_RUN_DB,
    Difference,
    MethodComparison,
    Row,
)

DIGITS: Final = dict(zip(FIGURES, (2, 2, 3, 2, 2), strict=True))


def shares_table(comparison: MethodComparison, group: str) -> Table:
    """Return the median share within one JND, a row for each texture or stroke."""
    rows = []
    for name in [*comparison.names(group), group]:
        by_moment = {(row.moment, row.method): row for row in comparison.rows(name)}
        cells = []
        for moment in MOMENTS:
            present = [by_moment.get((moment, method)) for method in comparison.methods]
            cells.append(" / ".join(_share(row) for row in present))
        rows.append([name if name != group else f"all {group}", *cells])
    caption = f"Share of the plane within one JND, medians: {' / '.join(comparison.methods)}."
    return Table(["session", *MOMENTS], rows, caption)


def _share(row: Row | None) -> str:
    return "-" if row is None else f"{row.spread['within_jnd'].median:.2f}"


def figures_table(comparison: MethodComparison, name: str) -> Table:
    """Return all figures of a texture, stroke or group, a row for each moment and method."""
    differences = {
        (d.moment, d.method): d for d in comparison.differences(name) if d.figure == "within_jnd"
    }
    rows = []
    for row in comparison.rows(name):
        spread = row.spread["within_jnd"]
        difference = differences.get((row.moment, row.method))
        rows.append(
            [
                row.moment,
                row.method,
                str(row.sessions),
                f"{spread.median:.2f}",
                f"{spread.low:.2f}-{spread.high:.2f}",
                *(number(row.spread[f].median, DIGITS[f]) for f in FIGURES[1:]),
                number(row.spread["band_error_db"].median / ALL_RUN_TO_RUN_DB, 1),
                "" if difference is None else f"{difference.mean:+.3f}",
                "" if difference is None else f"{difference.standard_error:.3f}",
            ]
        )
    columns = ["moment", "method", "of", "share", "10-90 %", "level (dB)", "GFC"]
    columns += ["spectrum (dB)", "bands (dB)", "times run-to-run", "share less first", "noise"]
    return Table(columns, rows, f"{name}: medians over sessions.")


def bands_table(comparison: MethodComparison, group: str) -> Table:
    """Return the error of each band of a group, a row for each moment and method."""
    rows = [
        [
            row.moment,
            row.method,
            *(
                f"{number(value, 2)} ({number(value / run_db, 1)})"
                for value, run_db in zip(row.bands_db, RUN_TO_RUN_DB, strict=True)
            ),
        ]
        for row in comparison.rows(group)
    ]
    edges = [f"{edge:.0f}" for edge in BAND_EDGES_HZ]
    columns = [f"{low}-{high} Hz" for low, high in pairwise(edges)]
    caption = (
        f"{group}: error of each band's power, dB rms over the grid, medians over sessions; in "
        "brackets, over what a real surface scatters from run to run."
    )
    return Table(["moment", "method", *columns], rows, caption)


def difference_sentences(comparison: MethodComparison, method: str) -> list[str]:
    """Say of each figure how often a method is better or worse than the first beyond noise."""
    names = [name for group in comparison.groups for name in comparison.names(group)]
    every = [d for name in names for d in comparison.differences(name) if d.method == method]
    sentences = []
    for figure in FIGURES:
        mine = [d for d in every if d.figure == figure]
        worse = [f"{d.name} at {d.moment} by {_change(d)}" for d in mine if d.verdict == "worse"]
        better = sum(d.verdict == "better" for d in mine)
        sentences.append(
            f"{figure}: {method} is better than {comparison.methods[0]} beyond noise in {better} "
            f"of {len(mine)} comparisons, worse in {len(worse)}"
            + (f" ({'; '.join(worse)})." if worse else ".")
        )
    return sentences


def _change(difference: Difference) -> str:
    digits = DIGITS[difference.figure] + 1
    return f"{difference.mean:+.{digits}f} ± {difference.standard_error:.{digits}f}"
