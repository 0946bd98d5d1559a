"""Compile the kernels of a program in parallel processes, if the cache lacks them."""

import gc
import json
import os
import subprocess
from collections.abc import Callable, Sequence
from typing import Final

from mmt.core.extras import optional_import
from mmt.core.running.child_process import ChildProcess

_MOST_PROCESSES: Final = 4
"""Each process first imports the modules and the compiler: more are hardly faster."""

_PROGRAM: Final = """
import json, sys
from mmt.core.kernel_cache import compile_share
compile_share(*json.loads(sys.argv[1]))
"""


def compile_kernels(
    modules: Sequence[str], on_start: Callable[[str], None], others: Sequence[str] = ()
) -> None:
    """Import modules and compile their kernels, in up to four parallel processes.

    Kernels in the cache are loaded. Kernels of modules imported later are compiled at their
    import.

    Parameters
    ----------
    modules
        Names of modules.
    on_start
        Called with a sentence for the user if there is anything to compile.
    others
        Names of modules that another process imports; their kernels are compiled too.

    Raises
    ------
    InputError
        A package that the numerics need is not installed.
    """
    with optional_import():
        from mmt.core.compiled import are_cached, collect_kernels, compile_collected

        kernels = collect_kernels(modules)
    if not are_cached(kernels):
        on_start(
            "compiling the numerics, at the first start only (10 to 30 s, on a busy machine longer)"
        )
        _compile_beside([*modules, *others])
    compile_collected(kernels)  # loads them; compiles any that a failed process left


def _compile_beside(modules: Sequence[str]) -> None:
    shares = min(os.cpu_count() or 1, _MOST_PROCESSES)
    processes = [
        ChildProcess(
            *("-c", _PROGRAM, json.dumps([modules, share, shares])),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for share in range(shares)
    ]
    try:
        for process in processes:
            process.wait()
    finally:
        for process in processes:
            process.close()


def compile_share(modules: Sequence[str], share: int, shares: int) -> None:
    """Compile kernels into the cache, as one of several parallel processes.

    Every process compiles all kernels that the cache lacks. Each begins at another kernel, so
    that none waits for another process.

    Parameters
    ----------
    modules
        As of `compile_kernels`.
    share, shares
        The number of this process, from 0, and how many there are.
    """
    from mmt.core.compiled import collect_kernels, compile_collected

    gc.disable()  # the compiler's objects live on, and the process is short
    kernels = collect_kernels(modules)
    order = list(kernels)
    if share % 2:
        order.reverse()  # pairs of processes work from both ends
    start = share // 2 * 2 * len(order) // shares
    compile_collected({each: kernels[each] for each in [*order[start:], *order[:start]]})
