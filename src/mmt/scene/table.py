"""Base classes for the tables of a scene, and what to say of one that is not valid."""

import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from mmt.core.errors import without_secrets

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
