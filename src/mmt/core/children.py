"""Commands of Python processes that import nothing from the current folder.

A file there with the name of a standard module, such as ``random.py``, would be imported in its
place. Folders in `PYTHONPATH` are still searched.
"""

import os
import sys
from pathlib import Path


def python_command(*arguments: str) -> list[str]:
    """Return the command of a Python process with these arguments."""
    return [sys.executable, "-P", *arguments]


def import_path() -> str:
    """Return a `PYTHONPATH` with which a child can import the modules that this process can."""
    named = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    here = {Path.cwd()} - {Path(each).resolve() for each in named}
    return os.pathsep.join(each for each in sys.path if each and Path(each).resolve() not in here)
