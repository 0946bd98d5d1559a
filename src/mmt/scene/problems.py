"""Error messages for an invalid table, which name the key, the value and the allowed values."""

import re
from dataclasses import fields, is_dataclass
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError

from mmt.core.errors import without_secrets

_UNKNOWN_KEY: Final = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's error types for an unknown key: in a model, and in a dataclass."""
_ALTERNATIVE: Final = re.compile(r"int|float|constrained-\w+|\w+\[.*\]")
"""Matches the elements that Pydantic adds to an error's location for the members of a union."""


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
