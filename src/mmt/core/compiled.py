"""The decorator that compiles numerical kernels, caches them and releases the interpreter lock."""

import gc
import importlib
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar, cast

import numba

from mmt.core.kernel_cache import drop_stale_kernels

Function = TypeVar("Function", bound=Callable[..., object])

_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # none is called from C
}

_collected: dict[Any, list[str]] | None = None
"""The kernels that `compile_share` is to compile, with their signatures; None everywhere else."""

drop_stale_kernels()


def kernel(*signatures: str) -> Callable[[Function], Function]:
    """Compile a function ahead of its first call.

    Explicit signatures make the compiler run at import, so that a service that has
    imported its kernels never compiles while it runs. The result is cached on disk and
    releases the interpreter lock. Floating point stays strict: no reordering, so that a
    result does not depend on the block size or on the machine's vector width.

    Parameters
    ----------
    *signatures
        numba signatures, e.g. ``"f8[::1](f8[::1], i8)"``; at least one.
    """
    if not signatures:
        message = "a kernel needs at least one explicit signature"
        raise ValueError(message)

    def decorate(function: Function) -> Function:
        if _collected is None:
            return cast(Function, numba.njit(list(signatures), **_OPTIONS)(function))
        later = numba.njit(**_OPTIONS)(function)
        _collected[later] = list(signatures)
        return cast(Function, later)

    return decorate


def compile_share(modules: Sequence[str], share: int, shares: int) -> None:
    """Compile the kernels that modules import into the cache, beside other processes.

    Every process compiles all that it does not find in the cache, each beginning elsewhere, so
    that none waits for another. It is for a process of its own: its kernels are not callable as
    others are.

    Parameters
    ----------
    modules
        Names of modules, imported here.
    share, shares
        The number of this process, from 0, and how many there are.
    """
    global _collected  # noqa: PLW0603 - read by the decorator in each module that is imported
    _collected = {}
    gc.disable()  # compiling makes much that lives on; the process is short
    for module in modules:
        importlib.import_module(module)
    order = list(_collected)
    if share % 2:
        order.reverse()  # two meet in the middle
    first = share // 2 * 2 * len(order) // shares
    for each in [*order[first:], *order[:first]]:
        _compile_with_callees(each, _collected)


def _compile_with_callees(each: Any, signatures: dict[Any, list[str]]) -> None:
    if each.signatures:
        return
    function = each.py_func
    for name in function.__code__.co_names:
        callee = function.__globals__.get(name)
        if isinstance(callee, type(each)):
            _compile_with_callees(callee, signatures)
    for signature in signatures[each]:
        each.compile(signature)
    each.disable_compile()
