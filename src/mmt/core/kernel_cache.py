"""The cache of compiled kernels on disk; nothing is compiled in this process."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from mmt.core.extras import require

KERNELS: Final = Path(__file__).parents[1] / "texture"
"""Folder of the kernels' sources; numba caches compiled code in folders beside them."""

_MOST_PROCESSES: Final = 4
"""Each begins with imports and the compiler's own: more of them are hardly quicker."""

_PROGRAM: Final = """
import json, sys
from mmt.core.compiled import compile_share
compile_share(*json.loads(sys.argv[1]))
"""


def drop_stale_kernels(sources: str | Path = KERNELS) -> bool:
    """Delete the compiled kernels of a folder if any of its sources has changed since.

    numba renews a cached kernel when its own file changes, not when a kernel that it has
    inlined from another file does. Returns whether anything was stale.
    """
    sources = Path(sources)
    cache = sources / "__pycache__"
    digest = hashlib.sha256()
    for source in sorted(sources.rglob("*.py")):
        digest.update(str(source.relative_to(sources)).encode() + source.read_bytes())
    stamp = cache / "kernels.sha256"
    with suppress(OSError):
        if stamp.exists() and stamp.read_text() == digest.hexdigest():
            return False
        for compiled in sources.rglob("__pycache__/*.nb[ci]"):
            compiled.unlink(missing_ok=True)
        cache.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest())
    return True


def kernels_are_compiled() -> bool:
    """Return whether the kernels of the present sources are cached."""
    return not drop_stale_kernels() and any(KERNELS.rglob("__pycache__/*.nbi"))


def compile_kernels(modules: Sequence[str], on_start: Callable[[str], None]) -> None:
    """Compile the kernels that modules import, in a process for each processor; wait for them.

    Nothing happens where kernels are cached. What is not compiled here, because another module
    imports it later or a process failed, is compiled when it is imported.

    Parameters
    ----------
    modules
        Names of modules.
    on_start
        Called with a sentence for a person before it begins.

    Raises
    ------
    InputError
        The compiler is not installed.
    """
    require("numba")
    if not os.access(KERNELS, os.W_OK):
        return  # numba caches them elsewhere then, where nothing says whether they are
    if kernels_are_compiled():
        return
    on_start("compiling the numerics, at the first start only (10 to 20 s)")
    shares = min(os.cpu_count() or 1, _MOST_PROCESSES)
    with ExitStack() as stack:
        processes = []
        for share in range(shares):
            command = [sys.executable, "-c", _PROGRAM, json.dumps([list(modules), share, shares])]
            process = subprocess.Popen(  # noqa: S603 - this interpreter, and names of modules
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            processes.append(process)
        for process in processes:
            process.wait()
