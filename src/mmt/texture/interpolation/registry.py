"""Names of the interpolators; nothing compiled is imported before one of them is loaded."""

from importlib.metadata import EntryPoint, entry_points
from typing import Final

GROUP: Final = "mmt.interpolators"
"""The group of entry points under which another package offers interpolators by name."""

INTERPOLATORS: Final[dict[str, str]] = {
    "delaunay": "mmt.texture.interpolation.delaunay",
    "nearest": "mmt.texture.interpolation.nearest",
    "rbf": "mmt.texture.interpolation.radial_basis.interpolator",
}
"""Name -> module of the interpolators that are part of mmt."""


def offered() -> dict[str, EntryPoint]:
    """Return the interpolators that other installed packages offer, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def check_interpolator(name: str) -> None:
    """Raise `ValueError` where no interpolator has a name.

    Raises
    ------
    ValueError
        There is none of that name; the message lists those that there are.
    """
    if name not in INTERPOLATORS and name not in offered():
        names = ", ".join(sorted({*INTERPOLATORS, *offered()}))
        raise ValueError(
            f"interpolator is {name!r}, allowed are {names}, and names that other packages "
            f"offer as entry points of {GROUP}"
        )
