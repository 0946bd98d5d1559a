"""Plug-ins: what installed packages offer by name, as entry points; the product's own alike.

The groups are ``mmt.commands``, ``mmt.devices``, ``mmt.files`` and ``mmt.generators``.
"""

import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Final

DISTRIBUTION: Final = "mmt-haptics"
"""The distribution that the product is installed as."""


def offered(group: str) -> Mapping[str, EntryPoint]:
    """Return what is offered in a group of entry points, by name.

    A name that the product offers itself cannot be taken by another package.
    """
    entries = sorted(_installed(group, tuple(sys.path)), key=is_own)
    return {entry.name: entry for entry in entries}


def is_own(entry: EntryPoint) -> bool:
    """Return whether an entry point is the product's own."""
    return entry.dist is not None and entry.dist.name == DISTRIBUTION


@lru_cache(maxsize=16)
def _installed(group: str, _path: tuple[str, ...]) -> EntryPoints:
    """Read the entry points of a group, which takes some milliseconds."""
    return entry_points(group=group)
