"""A recorded session's surfaces in a report: a table of the stays, and the way over them."""

from mmt.evaluation.document import Block, Heading, Paragraph, Table
from mmt.evaluation.recorded_surfaces import SurfaceParts
from mmt.evaluation.report_files import picture


def surface_blocks(parts: SurfaceParts, duration_s: float) -> list[Block]:
    """Return the section of a report on which surface the tool was on, and when."""
    from mmt.evaluation.surface_figure import surfaces_over_time

    caption = "Found: the surface that the leader took the tool to be on, by its number."
    if parts.course is not None:
        caption += " Shade: the known texture that was under it."
    return [
        Heading("Surfaces"),
        Paragraph(account(parts)),
        stay_table(parts),
        picture("surfaces", caption, surfaces_over_time(parts, duration_s)),
    ]


def account(parts: SurfaceParts) -> str:
    """Say in a sentence how many surfaces were found."""
    found, stays = len(parts.sessions), len(parts.stays)
    sentence = f"{found} surface{'s' * (found != 1)} in {stays} stay{'s' * (stays != 1)}"
    if parts.truth is not None:
        sentence += f"; the tool was really on {len(set(parts.truth.tolist()))}"
    return (
        f"{sentence}. Each has a model of its own, which is evaluated below over the time that was "
        "spent on it, stay after stay."
    )


def stay_table(parts: SurfaceParts) -> Table:
    """Return a row for each stay."""
    rows: list[tuple[str, ...]] = [
        (
            str(stay.surface),
            f"{stay.from_s:.2f}",
            f"{stay.to_s:.2f}",
            "" if stay.found_s is None else f"{stay.found_s:.2f}",
            stay.truth or "",
        )
        for stay in parts.stays
    ]
    columns = ["surface", "from (s)", "to (s)", "found at (s)", "mostly on"]
    if parts.course is None:
        columns, rows = columns[:-1], [row[:-1] for row in rows]
    return Table(columns, rows)
