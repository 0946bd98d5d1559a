"""How long modules take to import, each by itself, in fresh processes."""

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from typing import Final

from mmt.core.errors import MmtError

REPEATS: Final = 2
"""Fresh processes; the quickest import of each module counts."""

_LONGEST_S: Final = 300.0
_LINE: Final = re.compile(r"import time:\s*(\d+) \|\s*\d+ \|\s*(\S+)")
# the interpreter's own __import__ is timed, importlib's import_module is not
_PROGRAM: Final = """
import contextlib, json, sys
for name in json.load(sys.stdin):
    with contextlib.suppress(ImportError):
        __import__(name)
"""


def import_times_s(modules: Sequence[str], repeats: int = REPEATS) -> dict[str, float]:
    """Return the seconds that each module took, what it imported itself not counted.

    Parameters
    ----------
    modules
        In the order in which they are imported, as ``sys.modules`` has them. One that cannot
        be imported by its name stops nothing.
    repeats
        How many processes import them.

    Raises
    ------
    MmtError
        A process that imports them fails or hangs.
    """
    times: dict[str, list[float]] = {}
    for _ in range(repeats):
        for microseconds, name in _LINE.findall(_importing(modules)):
            times.setdefault(name, []).append(int(microseconds) * 1e-6)
    return {name: min(times[name]) for name in modules if name in times}


def _importing(modules: Sequence[str]) -> str:
    try:
        ended = subprocess.run(  # noqa: S603 - this interpreter and the program above
            [sys.executable, "-X", "importtime", "-c", _PROGRAM],
            input=json.dumps(list(modules)),
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=True,
        )
    except subprocess.SubprocessError as error:
        raise MmtError(f"the imports cannot be timed: {_said(error)}") from error
    return ended.stderr


def _said(error: subprocess.SubprocessError) -> str:
    stderr = getattr(error, "stderr", None)
    lines = stderr.splitlines() if isinstance(stderr, str) else []
    own = [line for line in lines if not line.startswith("import time:")]
    return own[-1] if own else str(error)
