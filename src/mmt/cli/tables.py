"""Summaries as tables for people."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table


def summary_table(title: str, summary: Mapping[str, Any]) -> Table:
    """Return a summary's nested tables as rows of part, figure, value."""
    table = Table(title=title, title_justify="left", show_header=False, pad_edge=False)
    table.add_column("part", style="bold")
    table.add_column("figure")
    table.add_column("value")
    for part, content in summary.items():
        rows = flatten(content)
        for index, (name, value) in enumerate(rows):
            last = index == len(rows) - 1
            table.add_row(part if index == 0 else "", name, value, end_section=last)
    return table


def flatten(content: object, prefix: str = "") -> list[tuple[str, str]]:
    """Return nested mappings as (dotted name, text) pairs; empty values are left out."""
    if not isinstance(content, Mapping):
        return [] if content in (None, "", [], {}) else [(prefix, as_text(content))]
    rows: list[tuple[str, str]] = []
    for name, value in content.items():
        label = str(name).replace("_", " ")
        rows += flatten(value, f"{prefix}, {label}" if prefix else label)
    return rows


def as_text(value: object) -> str:
    """Return a value as a person wants to read it."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(as_text, value))
    if isinstance(value, list):
        return "; ".join(
            " ".join(as_text(v) for v in item.values()) if isinstance(item, Mapping) else str(item)
            for item in value
        )
    return str(value)
