"""Tables for people: their one style in a terminal, and figures and their keys as text."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

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


def flatten(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested mappings by the labels of their keys, outermost first."""
    flat: dict[str, Any] = {}
    for name, value in content.items():
        full = f"{prefix}{label(name)}"
        flat |= flatten(value, f"{full}, ") if isinstance(value, Mapping) else {full: value}
    return flat


def as_text(value: object) -> str:
    """Return a value as text for people, a dash for None."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.4g}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{label(name)} {as_text(item)}" for name, item in value.items())
    if isinstance(value, tuple | list):
        texts = [
            " ".join(map(as_text, item.values())) if isinstance(item, Mapping) else as_text(item)
            for item in value
        ]
        return (", " if isinstance(value, tuple) else "; ").join(texts)
    return str(value)
