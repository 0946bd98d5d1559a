"""Numbers as text for people; a dash if there is none."""

from collections.abc import Mapping, Sequence

from mmt.core.tables import label


def number(value: float | None, digits: int) -> str:
    """Return a number with this many decimals."""
    return "-" if value is None else f"{value:.{digits}f}"


def seconds(value: float | None) -> str:
    """Return the time at which a criterion was met, or "never"."""
    return "never" if value is None else f"{value:.1f}"


def share(value: float | None) -> str:
    """Return a share in percent."""
    return "-" if value is None else f"{100 * value:.0f} %"


def plain_text(value: object) -> str:
    """Return any value of a summary as text."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{label(name)} {plain_text(item)}" for name, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "; ".join(plain_text(item) for item in value)
    return str(value)
