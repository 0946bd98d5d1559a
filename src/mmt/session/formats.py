"""The formats of session files, by suffix: entry points of the group ``mmt.files``.

Their names are ``read`` (a whole session), ``write`` or ``import`` (another program's recording)
and the suffix, such as ``import.csv``. ``write`` and ``import`` without a suffix are for folders;
a folder recognized by a file in it has that file's path, as in ``import/meta/info.json``.

- A reader is called with the path and returns a `RecordedSession`.
- A writer is called with the path and the session.
- An importer is called with the path, a function that tells whether a column of a given name is
  wanted, and the `ImportOptions`; it returns `SourceColumns`. Its errors need not name the file.
  It runs in a child process, see `mmt.session.importing.reading_child`: what it returns must be
  picklable.

``join.NAME``, such as ``join.lerobot``, is a function of sessions and a folder that makes a data
set of them (keywords ``fps``, ``task``, ``replace``). ``model.SUFFIX`` is a function that reads a
texture model of another program.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Literal

from mmt.core.plugins import load, offered

GROUP: Final = "mmt.files"

Verb = Literal["read", "write", "import", "join", "model"]


def suffixes(verb: Verb) -> list[str]:
    """Return the suffixes that a verb supports, or for ``join`` the names, each with its dot."""
    names = sorted(name for name in offered(GROUP) if name.startswith(f"{verb}."))
    return [name.removeprefix(verb) for name in names]


def find_format(verb: Verb, path: Path) -> Callable[..., Any] | None:
    """Import the function for a verb and the suffix, or folder, of a path; None if there is none.

    Raises
    ------
    InputError
        The function cannot be imported.
    """
    files = offered(GROUP)
    name = f"{verb}{path.suffix.lower()}"
    if verb == "import" and path.is_dir():
        told = (each for each in files if each.startswith(f"{verb}/"))
        name = next((each for each in told if (path / each[len(verb) + 1 :]).is_file()), verb)
    return load(files[name], f"format of {path}") if name in files else None
