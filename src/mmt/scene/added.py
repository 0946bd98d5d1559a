"""Parts that other packages add to the leader, and the tables that they add to a scene.

A package names each part as an entry point of the group ``mmt.parts``: an `AddedPart`, in a module
that imports nothing of `mmt` but bases of tables (this one, `mmt.scene.table`,
`mmt.scene.secured_table`), since a scene's tables are made from it. The part's name is that of its
table, if it has one.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

from mmt.core.errors import InputError
from mmt.core.plugins import is_own, load, offered
from mmt.scene.table import PartTable


class PassingTable(PartTable):
    """Base of the tables of parts that pass a follower's frames on."""

    channels: Literal["all", "needed"] = "all"


class Flag(NamedTuple):
    """An option of a command, without a value, that gives a scene tables."""

    name: str
    """Such as ``--share``."""
    help: str
    tables: tuple[str, ...]
    """Tables that the scene has then, empty if its file has none."""
    command: Literal["leader", "demo"] = "leader"
    guest: str = ""
    """The module and the function that makes an `mmt.cli.guests.Guest` of the scene, "" for none.

    The demo has it also without the option, in a scene that has the tables.
    """


class AddedPart(NamedTuple):
    """A part of the leader from another package."""

    home: str
    """The module and the class, which has `build(session, parts)`: the part, or None for none."""
    before: str
    """The part before whose verbs this one's are called."""
    table: type[PartTable] | None = None
    """The table that the part adds to a scene, or None if it adds none."""
    key: str = ""
    """Key of another table that asks for a part without one, such as ``rendering.generator``."""
    tasks: tuple[str, ...] = ()
    """Names of the tasks that it runs beside the ticks."""
    rules: str = ""
    """The module and the function that, given a scene with the table, returns what it may not be.

    It returns `mmt.scene.scene.Rules`, and "" is for none.
    """
    flags: tuple[Flag, ...] = ()
    """Options that it adds to commands."""
    secrets: tuple[str, ...] = ()
    """Environment variables with secrets that a scene with the table cannot run without."""
    foreign: tuple[str, ...] = ()
    """Tables of the package's other commands, whose variables a scene passes over."""


@cache
def added_parts() -> Mapping[str, AddedPart]:
    """Return the added parts of installed packages, by name.

    One that cannot be loaded is left out; `problem_of` tells why.

    Raises
    ------
    InputError
        One of the product's own cannot be loaded.
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
    """Return the options that added parts give a command."""
    flags = (flag for part in added_parts().values() for flag in part.flags)
    return [flag for flag in flags if flag.command == command]


def tables_of(flags: Iterable[Flag]) -> list[str]:
    """Return the names of the tables that a scene has by these options."""
    return [name for flag in flags for name in flag.tables]


def imported(home: str) -> Any:
    """Return what a home, ``module:name``, holds."""
    module, _, name = home.partition(":")
    return getattr(import_module(module), name)


@cache
def added_tables() -> Mapping[str, type[PartTable]]:
    """Return the tables that added parts add to a scene, by name."""
    return {name: part.table for name, part in added_parts().items() if part.table is not None}


_problems: dict[str, str] = {}


def problem_of(name: str) -> str | None:
    """Return why the added part of this name was left out, or None if it was not."""
    return _problems.get(name)
