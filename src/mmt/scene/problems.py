"""What is wrong with a table, as sentences that name the key, the value and what is allowed."""

import re
from dataclasses import fields, is_dataclass
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError

from mmt.core.printable import without_secrets

_UNKNOWN_KEY: Final = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's type of the error for a table that is a model, and for one that is a dataclass."""
_ALTERNATIVE: Final = re.compile(r"int|float|constrained-\w+|\w+\[.*\]")
"""What Pydantic puts into a place for each type that a key may have."""


def explain_problems(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Return a sentence for each problem; `model` is what was validated, where it is known."""
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
            if sentences and sentences[-1].startswith(value):  # another alternative for it
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
    """Return the keys of a table and what each is annotated with; none where it is no table."""
    if issubclass(table, BaseModel):
        return {name: field.annotation for name, field in table.model_fields.items()}
    return {field.name: field.type for field in fields(table)} if is_dataclass(table) else {}
