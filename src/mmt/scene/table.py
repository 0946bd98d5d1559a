"""Tables of a scene, and the parts and tables that other packages add to it.

A package offers each part as an entry point of the group ``mmt.parts``, which names an
`AddedPart`. A part with a table has the table's name. `Scene` is built from these objects in every
process, so the modules that name them import late whatever imports `Scene` or takes long. They may
import this module, `mmt.leader.part` and `mmt.core`.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, NamedTuple, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from mmt.core.errors import InputError, without_secrets
from mmt.core.plugins import is_own, load, offered

Service = Literal["leader", "follower"]

_UNKNOWN_KEY: Final = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's error types for an unknown key: in a model, and in a dataclass."""
_ALTERNATIVE: Final = re.compile(r"int|float|constrained-\w+|\w+\[.*\]")
"""Matches the elements that Pydantic adds to an error's location for the members of a union."""


class Table(BaseModel):
    """Immutable table of a scene; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OptionalTable:
    """Base class for the settings of a part that a scene may leave out."""

    runs_in: ClassVar[tuple[Service, ...]] = ("leader",)
    """The services in which the part runs, unless `services` depends on the table's values."""

    @property
    def services(self) -> tuple[Service, ...]:
        """The services in which the part runs with these values."""
        return self.runs_in


class PartTable(OptionalTable, Table):
    """The table of a part, as a pydantic model."""

    gives: ClassVar[tuple[Literal["model", "force"], ...]] = ()
    """Data that the part receives from another machine, so that no follower has to send it."""


class SecuredTable(PartTable):
    """Base class: token, certificate, key and authority of one side of a connection."""

    token_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    authority: Path | None = None

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both or neither")
        return self


class ServedTable(SecuredTable):
    """Base class for tables of the side that listens."""

    host: str = "127.0.0.1"
    port: int = Field(0, ge=0, le=65_535)
    open: bool = False
    allow_origins: tuple[str, ...] = ()

    @field_validator("allow_origins")
    @classmethod
    def _origins(cls, origins: tuple[str, ...]) -> tuple[str, ...]:
        for origin in origins:
            if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/\s*]+", origin):
                raise ValueError(
                    f"{origin!r} is no origin: one is as https://lab.example or "
                    "http://127.0.0.1:5173, without a path"
                )
        return origins

    def url(self, port: int | None = None) -> str:
        """Return the URL for the other side, with `port`, or the table's port if None."""
        secure = self.certificate is not None or self.authority is not None
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if secure else 'http'}://{host}:{self.port if port is None else port}"


def explain_problems(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Return a sentence for each problem; `model` is the validated model, or None if unknown."""
    sentences = []
    for problem in error.errors(include_url=False):
        place = ".".join(p for p in map(str, problem["loc"]) if not _ALTERNATIVE.fullmatch(p))
        if problem["type"] in _UNKNOWN_KEY:
            allowed = "" if model is None else f"; allowed are {_allowed(problem['loc'], model)}"
            sentences.append(f"{place} is not a key{allowed}")
        elif problem["type"] == "missing":
            sentences.append(f"{place} is missing: it must be given")
        elif problem["type"] == "value_error":
            where = f"{place}: " if place else ""
            sentences.append(where + problem["msg"].removeprefix("Value error, "))
        else:
            where = f"{place} is " if place else ""
            value, message = f"{where}{problem['input']!r}: ", problem["msg"]
            if sentences and sentences[-1].startswith(value):  # another member of the union
                sentences[-1] += f", or {message.removeprefix('Input should be ')}"
            else:
                sentences.append(value + message)
    return without_secrets("; ".join(sentences))


def _allowed(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    table: type[Any] = model
    for part in location[:-1]:
        annotation = _annotations(table)[str(part)]
        candidates = [annotation, *get_args(annotation)]
        table = next(each for each in candidates if isinstance(each, type) and _annotations(each))
    return ", ".join(_annotations(table))


def _annotations(table: type[Any]) -> dict[str, Any]:
    """Return the annotation of each key of a table, or {} if the class is not a table."""
    if issubclass(table, BaseModel):
        return {name: field.annotation for name, field in table.model_fields.items()}
    return {field.name: field.type for field in fields(table)} if is_dataclass(table) else {}


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
