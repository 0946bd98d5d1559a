"""The kernels of a program, compiled in processes beside it where the cache lacks them."""

import gc
import json
import os
import subprocess
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from mmt.core.children import python_command
from mmt.core.extras import requiring
from mmt.core.process import release_compiler, step_back

if TYPE_CHECKING:
    from mmt.core.compiled import Kernels

LONGEST_COMPILATION_S: Final = 120.0
"""On a busy machine; a shorter session could be over before its modelling begins beside it."""

_MOST_PROCESSES: Final = 4
"""Each begins with imports and the compiler's own: more of them are hardly quicker."""

_PROGRAM: Final = """
import json, sys
from mmt.core.kernel_cache import compile_share
compile_share(*json.loads(sys.argv[1]))
"""


class Compilation:
    """Processes that compile kernels beside this program, which does not need them yet.

    Parameters
    ----------
    kernels
        As of `mmt.core.compiled.collect_kernels`.
    processes
        Of `compile_share`, in the order of their shares.
    """

    def __init__(self, kernels: "Kernels", processes: Sequence[subprocess.Popen[bytes]]) -> None:
        self._kernels = kernels
        self._processes = processes
        self._stopped = False

    def finish(self) -> None:
        """Wait for the processes and load the kernels; for a thread, it holds the lock little."""
        from mmt.core.compiled import compile_collected

        for process in self._processes:
            with process:
                process.wait()
        if not self._stopped:
            compile_collected(self._kernels)  # after a process that failed it compiles them
            release_compiler()

    def wait_for_first(self) -> None:
        """Wait until the first process has compiled what is needed at once."""
        output = self._processes[0].stdout
        assert output is not None  # noqa: S101 - it was asked for
        output.readline()

    def stop(self) -> None:
        """End the processes, where what they compile is not needed any more."""
        self._stopped = True
        for process in self._processes:
            with process:
                process.kill()


def compile_kernels(
    modules: Sequence[str], on_start: Callable[[str], None], first: Sequence[str] | None = None
) -> Compilation | None:
    """Import modules and compile their kernels, in a process for each processor.

    What is in the cache is loaded. Kernels of modules that are imported later are compiled when
    they are.

    Parameters
    ----------
    modules
        Names of modules.
    on_start
        Called with a sentence for a person if there is anything to compile.
    first
        Names of modules of kernels: these, and what they call, are compiled when this function
        returns; the others are compiled beside the program that goes on. None waits for all.

    Returns
    -------
    Compilation | None
        What compiles the others; None where all are compiled.

    Raises
    ------
    InputError
        A package that the numerics need is not installed.
    """
    with requiring():
        from mmt.core.compiled import are_cached, collect_kernels, compile_collected

        kernels = collect_kernels(modules)
    if are_cached(kernels):
        compile_collected(kernels)
        return None
    lasts = "5 to 15 s" if first is None else "2 to 5 s; modelling begins some 10 s later"
    on_start(f"compiling the numerics, at the first start only ({lasts}, on a busy machine longer)")
    compilation = Compilation(kernels, _start_processes(modules, first))
    try:
        if first is not None:
            compilation.wait_for_first()
            compile_collected(kernels, first)
            return compilation
        compilation.finish()
    except BaseException:
        compilation.stop()
        raise
    return None


def _start_processes(
    modules: Sequence[str], first: Sequence[str] | None
) -> list[subprocess.Popen[bytes]]:
    shares = min(os.cpu_count() or 1, _MOST_PROCESSES)
    if first is not None:
        shares = max(shares - 1, 1)  # a processor is left to the ticks
    return [
        subprocess.Popen(  # noqa: S603 - this interpreter, and names of modules
            python_command("-c", _PROGRAM, json.dumps([modules, first, share, shares])),
            stdout=subprocess.PIPE if share == 0 else subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the program, which stops them
        )
        for share in range(shares)
    ]


def compile_share(
    modules: Sequence[str], first: Sequence[str] | None, share: int, shares: int
) -> None:
    """Compile kernels into the cache, in a process of its own beside others.

    Every process compiles all that it does not find in the cache, each beginning elsewhere, so
    that none waits for another.

    Parameters
    ----------
    modules, first
        As of `compile_kernels`. Process 0 prints a line when the first are compiled.
    share, shares
        The number of this process, from 0, and how many there are.
    """
    from mmt.core.compiled import collect_kernels, compile_collected

    gc.disable()  # compiling makes much that lives on; the process is short
    kernels = collect_kernels(first or [])
    if share == 0 and first is not None:
        compile_collected(kernels, first)
        print(flush=True)
    if first is not None:
        step_back()
    kernels |= collect_kernels(modules)
    order = list(kernels)
    if share % 2:
        order.reverse()  # two meet in the middle
    start = share // 2 * 2 * len(order) // shares
    compile_collected({each: kernels[each] for each in [*order[start:], *order[:start]]})
