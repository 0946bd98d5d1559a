"""The kernels of a program, compiled in processes beside it where the cache lacks them."""

import gc
import json
import os
import subprocess
from collections.abc import Callable, Sequence
from typing import Final

from mmt.core.children import python_command
from mmt.core.extras import requiring

_MOST_PROCESSES: Final = 4
"""Each begins with imports and the compiler's own: more of them are hardly quicker."""

_PROGRAM: Final = """
import json, sys
from mmt.core.kernel_cache import compile_share
compile_share(*json.loads(sys.argv[1]))
"""


def compile_kernels(
    modules: Sequence[str], on_start: Callable[[str], None], others: Sequence[str] = ()
) -> None:
    """Import modules and compile their kernels, in a process for each processor.

    What is in the cache is loaded. Kernels of modules that are imported later are compiled when
    they are.

    Parameters
    ----------
    modules
        Names of modules.
    on_start
        Called with a sentence for a person if there is anything to compile.
    others
        Names of modules that another process imports; their kernels are compiled along.

    Raises
    ------
    InputError
        A package that the numerics need is not installed.
    """
    with requiring():
        from mmt.core.compiled import are_cached, collect_kernels, compile_collected

        kernels = collect_kernels(modules)
    if not are_cached(kernels):
        on_start(
            "compiling the numerics, at the first start only (5 to 15 s, on a busy machine longer)"
        )
        _compile_beside([*modules, *others])
    compile_collected(kernels)  # after a process that failed it compiles them


def _compile_beside(modules: Sequence[str]) -> None:
    shares = min(os.cpu_count() or 1, _MOST_PROCESSES)
    processes = [
        subprocess.Popen(  # noqa: S603 - this interpreter, and names of modules
            python_command("-c", _PROGRAM, json.dumps([modules, share, shares])),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the program, which stops them
        )
        for share in range(shares)
    ]
    try:
        for process in processes:
            process.wait()
    finally:
        for process in processes:
            with process:
                process.kill()


def compile_share(modules: Sequence[str], share: int, shares: int) -> None:
    """Compile kernels into the cache, in a process of its own beside others.

    Every process compiles all that it does not find in the cache, each beginning elsewhere, so
    that none waits for another.

    Parameters
    ----------
    modules
        As of `compile_kernels`.
    share, shares
        The number of this process, from 0, and how many there are.
    """
    from mmt.core.compiled import collect_kernels, compile_collected

    gc.disable()  # compiling makes much that lives on; the process is short
    kernels = collect_kernels(modules)
    order = list(kernels)
    if share % 2:
        order.reverse()  # two meet in the middle
    start = share // 2 * 2 * len(order) // shares
    compile_collected({each: kernels[each] for each in [*order[start:], *order[:start]]})
