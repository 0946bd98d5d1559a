"""The one style of the tables in a terminal."""

from rich.box import SIMPLE_HEAD
from rich.table import Table


def plain_table(title: str = "", *columns: str, padding: int = 1, header: bool = True) -> Table:
    """Return a table without borders, its title at the left.

    Parameters
    ----------
    title
        None is shown if it is empty.
    columns
        Names of text columns, folded if too long; the caller may add more.
    padding
        Spaces at the right of each cell, beside the one between columns.
    header
        Whether the names of the columns are shown.
    """
    table = Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, padding),
        show_header=header,
    )
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
