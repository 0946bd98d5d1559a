"""Check values against their annotations.

A field of a settings class states the allowed values once, as a type with bounds of
`annotated_types`. When a scene is read, pydantic checks these annotations; if a program makes
the settings itself, `check_fields` does.
"""

import math
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from numbers import Integral, Real
from operator import ge, gt, le, lt
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin
from typing import get_type_hints as type_hints

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt, Le, Lt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, SettingError

RateHz = Annotated[float, Ge(1), Le(1e6)]
"""A sampling rate."""

_BOUNDS: Final[dict[type, tuple[str, str, Callable[[Any, Any], bool]]]] = {
    Gt: ("gt", "above", gt),
    Ge: ("ge", "at least", ge),
    Lt: ("lt", "below", lt),
    Le: ("le", "at most", le),
}
_KINDS: Final = {float: "a finite number", int: "a whole number", str: "a text"}


def check_fields(settings: Any) -> None:
    """Check every field of a dataclass by its annotation.

    Raises
    ------
    SettingError
        A value is not allowed; the message names the field, the value and what is allowed.
    """
    owner: type = type(settings)
    allowed = _annotations(owner)
    for field in fields(settings):
        check(field.name, getattr(settings, field.name), allowed[field.name])


def check(name: str, value: object, allowed: Any) -> None:
    """Check a value by an annotation: a type, with or without bounds, a literal, or a union.

    Raises
    ------
    SettingError
        The value is not allowed, for instance NaN as a number or 2.5 as a whole number.
    """
    if not _fits(value, allowed):
        raise SettingError(f"{name} is {value!r}, allowed is {_described(allowed)}")


def real_numbers(name: str, values: npt.ArrayLike) -> FloatArray:
    """Return real or whole numbers, of any shape, as an array of float64.

    Raises
    ------
    InputError
        The values are text, complex or of another kind, or are rows of unequal length.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} is no array: {error}") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} is of {array.dtype}: real numbers are needed")
    return np.asarray(array, np.float64)


def finite_number(text: str) -> float:
    """Return the finite number in a text.

    Raises
    ------
    ValueError
        The text is no number, or the number is not finite.
    """
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{number} is not finite")
    return number


@cache
def _annotations(owner: type) -> dict[str, Any]:
    return type_hints(owner, include_extras=True)


def _fits(value: Any, allowed: Any) -> bool:
    origin, parts = get_origin(allowed), get_args(allowed)
    if origin is Annotated:
        bounds = ((_BOUNDS[type(bound)], bound) for bound in parts[1:])
        return _fits(value, parts[0]) and all(
            holds(value, getattr(bound, key)) for (key, _, holds), bound in bounds
        )
    if origin in {Union, UnionType}:
        return any(_fits(value, part) for part in parts)
    if origin is Literal:
        return isinstance(value, str) and value in parts
    if allowed is float:
        number = isinstance(value, Real) and not isinstance(value, bool)
        return number and _is_finite(value)
    if allowed is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    return isinstance(value, NoneType if allowed is None else allowed)


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number above all floats
        return False


def _described(allowed: Any) -> str:
    origin, parts = get_origin(allowed), get_args(allowed)
    if origin is Annotated:
        bounds = ((_BOUNDS[type(bound)], bound) for bound in parts[1:])
        limits = (f"{word} {getattr(bound, key):g}" for (key, word, _), bound in bounds)
        return f"{_described(parts[0])} {' and '.join(limits)}"
    if origin in {Union, UnionType}:
        return " or ".join(_described(part) for part in parts)
    if origin is Literal:
        return ", ".join(f'"{part}"' for part in parts)
    if allowed in {None, NoneType}:
        return "None"
    name: str = _KINDS.get(allowed, allowed.__name__)
    return name
