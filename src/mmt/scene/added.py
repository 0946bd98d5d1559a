"""Parts that other packages add to the leader, and the tables that they add to a scene.

A package offers each part as an entry point of the group ``mmt.parts``, which names an
`AddedPart`. A part with a table has the table's name. `Scene` is built from these objects in every
process, so the modules that name them import late whatever imports `Scene` or takes long. They may
import this module, `mmt.scene.table`, `mmt.leader.part` and `mmt.core`.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

from mmt.core.errors import InputError
from mmt.core.plugins import is_own, load, offered
from mmt.scene.table import PartTable


class PassingTable(PartTable):
    """Base class for tables of parts that forward the follower's frames."""

    channels: Literal["all", "needed"] = "all"


class Flag(NamedTuple):
    """A command-line flag that adds tables to the scene."""

    name: str
    """Such as ``--share``."""
    help: str
    tables: tuple[str, ...]
    """Tables that the flag adds, with default values, if the scene's file lacks them."""
    command: Literal["leader", "demo"] = "leader"
    side_service: str = ""
    """``module:function`` that makes a `mmt.cli.running.service.SideService`, or "" for none.

    The demo also makes it without the flag if the scene has the tables.
    """


class AddedPart(NamedTuple):
    """A part of the leader from another package."""

    home: str
    """``module:class``; the class's `build(session, parts)` returns the part, or None for none."""
    before: str
    """Name of the part before which this one is built and called."""
    table: type[PartTable] | None = None
    """The table that the part adds to a scene, or None if it adds none."""
    key: str = ""
    """For a part without a table: the key that enables it, such as ``rendering.generator``."""
    tasks: tuple[str, ...] = ()
    """Names of the tasks that the part runs beside the ticks."""
    rules: str = ""
    """``module:function`` that returns the `mmt.scene.scene.Rules` for a scene with the table.

    "" if there are no rules.
    """
    flags: tuple[Flag, ...] = ()
    """Flags that the part adds to commands."""
    secrets: tuple[str, ...] = ()
    """Environment variables with secrets that a scene with the table cannot run without."""
    foreign: tuple[str, ...] = ()
    """Tables of the package's other commands; a scene ignores environment variables for them."""


@cache
def added_parts() -> Mapping[str, AddedPart]:
    """Return the added parts of installed packages, by name.

    A part that cannot be loaded is left out; `import_problem` returns the reason.

    Raises
    ------
    InputError
        A part of this distribution cannot be loaded.
    """
    found = {}
    for name, entry in offered("mmt.parts").items():
        try:
            part = load(entry, f"part {name!r}")
        except InputError as error:
            if is_own(entry):
                raise
            _problems[name] = str(error)
            continue
        if isinstance(part, AddedPart):
            found[name] = part
        else:
            _problems[name] = f"part {name!r}: {entry.value} is no AddedPart"
    return found


def added_flags(command: str) -> list[Flag]:
    """Return the flags that added parts give a command."""
    flags = (flag for part in added_parts().values() for flag in part.flags)
    return [flag for flag in flags if flag.command == command]


def tables_of(flags: Iterable[Flag]) -> list[str]:
    """Return the names of the tables that these flags add."""
    return [name for flag in flags for name in flag.tables]


def imported(home: str) -> Any:
    """Import the object that ``module:name`` names."""
    module, _, name = home.partition(":")
    return getattr(import_module(module), name)


@cache
def added_tables() -> Mapping[str, type[PartTable]]:
    """Return the tables that added parts add to a scene, by name."""
    return {name: part.table for name, part in added_parts().items() if part.table is not None}


_problems: dict[str, str] = {}


def import_problem(name: str) -> str | None:
    """Return why the added part of this name was left out, or None if it was not."""
    return _problems.get(name)
