"""How Python processes are started: nothing that lies in the current folder is imported.

A file there that is named like a standard module, such as ``random.py``, would be imported in its
place. A folder that `PYTHONPATH` names is searched all the same.
"""

import os
import sys
from pathlib import Path


def python_command(*arguments: str) -> list[str]:
    """Return the command of a Python process with these arguments."""
    return [sys.executable, "-P", *arguments]


def import_path() -> str:
    """Return a `PYTHONPATH` by which a process imports what this one can."""
    named = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    here = {Path.cwd()} - {Path(each).resolve() for each in named}
    return os.pathsep.join(each for each in sys.path if each and Path(each).resolve() not in here)
