"""Choose a function by a file's suffix; its module is imported when it is used."""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mmt.core.errors import InputError


def choose(path: Path, table: Mapping[str, str], verb: str) -> Callable[..., Any]:
    """Return the function that a table of ``suffix: "module:function"`` has for a file.

    Raises
    ------
    InputError
        The suffix is not in the table; the message says what cannot be done (`verb`, as
        in "read") and which suffixes are known.
    """
    name = table.get(path.suffix.lower())
    if name is None:
        given = path.suffix or "a name without suffix"
        raise InputError(
            f"session {path}: {given} cannot be {verb}; the suffix must be one of "
            f"{', '.join(table)}"
        )
    module, _, function = name.partition(":")
    chosen: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return chosen
