"""Tables for people: their one style in a terminal, and labels for the keys of figures."""

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.table import Table

_UNITS: Final = {
    "nm rad": "N m/rad",
    "n s m": "N s/m",
    "mm s2": "mm/s²",
    "mm s": "mm/s",
    "m s3": "m/s³",
    "m s2": "m/s²",
    "n mm": "N/mm",
    "n s": "N/s",
    "n": "N",
    "hz": "Hz",
    "db": "dB",
    "mb": "MB",
    "mj": "mJ",
    "j": "J",
    "v": "V",
}
"""Units by the ending of a key, longer endings first. Other units, such as mm, stay as they are."""


def plain_table(title: str = "", *columns: str, padding: int = 1, header: bool = True) -> "Table":
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
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

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


def label(name: object) -> str:
    """Return a key such as ``rms_m_s2``, or its words, as a label such as "rms m/s²"."""
    words = str(name).replace("_", " ")
    for ending, unit in _UNITS.items():
        if words.endswith(f" {ending}"):
            return words.removesuffix(ending) + unit
    return words
