"""The texture models that come with the package, by name.

They are plain files beside this one, in the format of ``docs/reference/model-file.md``; what
they are models of, and how good they are, is in ``docs/reference/shipped-models.md``.
"""

from pathlib import Path
from typing import Final

from mmt.core.errors import InputError

FOLDER: Final = Path(__file__).parent
SUFFIX: Final = ".npz"


def shipped_models() -> dict[str, Path]:
    """Return the shipped models' files by name, in alphabetical order."""
    return {path.stem: path for path in sorted(FOLDER.glob(f"*{SUFFIX}"))}


def find_model(path: str | Path) -> Path:
    """Return the path of a file, or of the shipped model of this name.

    Raises
    ------
    InputError
        The path is a bare name, but neither that of a file nor of a shipped model.
    """
    path = Path(path)
    if path.exists() or path.suffix or path.name != str(path):
        return path
    shipped = shipped_models()
    if path.name in shipped:
        return shipped[path.name]
    raise InputError(f"model {path}: no such file; shipped are {', '.join(shipped) or 'none'}")
