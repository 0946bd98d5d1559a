"""The formats of session files, by suffix: entry points of the group ``mmt.files``.

Their names are ``read`` (a whole session), ``write`` and ``import`` (a recording of any program),
followed by the suffix, as ``import.csv``; ``write`` alone and ``import`` alone are of folders. A
kind of folder that a file in it tells has that file's path: ``import/meta/info.json``.

- a reader is called with the path and returns a `RecordedSession`;
- a writer with the path and the session;
- an importer with the path, whether a column of a name is wanted, and the `ImportOptions`, and
  returns `SourceColumns`.

``join`` and a name, as ``join.lerobot``, is a function of sessions and a folder that makes a data
set of them (keywords ``fps``, ``task``, ``replace``); ``model`` and a suffix one that reads a
texture model of another program.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Literal

from mmt.core.plugins import load, offered

GROUP: Final = "mmt.files"

Verb = Literal["read", "write", "import", "join", "model"]


def suffixes(verb: Verb) -> list[str]:
    """Return the suffixes, and of data sets the names behind a dot, that there is something for."""
    names = sorted(name for name in offered(GROUP) if name.startswith(f"{verb}."))
    return [name.removeprefix(verb) for name in names]


def find_format(verb: Verb, path: Path) -> Callable[..., Any] | None:
    """Import what reads, writes or imports a file of this suffix or this folder, None if nothing.

    Raises
    ------
    InputError
        It cannot be imported.
    """
    files = offered(GROUP)
    name = f"{verb}{path.suffix.lower()}"
    if verb == "import" and path.is_dir():
        told = (each for each in files if each.startswith(f"{verb}/"))
        name = next((each for each in told if (path / each[len(verb) + 1 :]).is_file()), verb)
    return load(files[name], f"format of {path}") if name in files else None
