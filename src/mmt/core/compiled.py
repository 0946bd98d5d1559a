"""The decorator that compiles numerical kernels, caches them and releases the interpreter lock."""

import hashlib
import importlib
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, cast

import numba

from mmt.core.errors import MmtError

Function = TypeVar("Function", bound=Callable[..., object])


class Compilation(NamedTuple):
    """How a kernel is to be compiled: the parameters of `kernel`."""

    signatures: list[str]
    inner: bool


Kernels = dict[Any, Compilation]
"""Kernels that are not compiled yet."""

KERNELS: Final = Path(__file__).parents[1] / "texture"
"""Folder of the kernels' sources; numba caches compiled code in folders beside them."""

_OPTIONS: Final[dict[str, Any]] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # no kernel is called from C
}

_collected: Kernels | None = None
"""Kernels that `collect_kernels` has collected so far; None while it does not run."""


def drop_stale_kernels(sources: str | Path = KERNELS) -> bool:
    """Delete the compiled kernels of a folder if any of its sources has changed since.

    numba recompiles a cached kernel if its own file changes, but not if a kernel that it
    inlines from another file changes. Another version of numba makes all stale. Returns whether
    anything was.
    """
    sources = Path(sources)
    cache = sources / "__pycache__"
    digest = hashlib.sha256(numba.__version__.encode())
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


drop_stale_kernels()


def kernel(*signatures: str, inner: bool = False) -> Callable[[Function], Function]:
    """Compile a function ahead of its first call.

    Explicit signatures make the compiler run at import, so that a service that has
    imported its kernels never compiles while it runs. The result is cached on disk and
    releases the interpreter lock. Floating point stays strict: no reordering, so that a
    result does not depend on the block size or on the machine's vector width.

    Parameters
    ----------
    *signatures
        numba signatures, e.g. ``"f8[::1](f8[::1], i8)"``; at least one.
    inner
        Whether only other kernels call it. A service whose kernels are in the cache does not load
        it then, which saves 0.3 MB: its callers' compiled code contains it.
    """
    if not signatures:
        message = "a kernel needs at least one explicit signature"
        raise ValueError(message)

    def decorate(function: Function) -> Function:
        now = list(signatures) if _collected is None else None
        try:
            kept = numba.njit(now, **_OPTIONS)(function)
        except RuntimeError as error:
            if "no locator" not in str(error):
                raise
            raise MmtError(
                f"compiled numerics cannot be kept: neither {KERNELS} nor the user's cache can be "
                "written to; name a folder that can in the variable NUMBA_CACHE_DIR"
            ) from error
        if _collected is not None:
            _collected[kept] = Compilation(list(signatures), inner)
        return cast(Function, kept)

    return decorate


def collect_kernels(modules: Sequence[str]) -> Kernels:
    """Import modules and return their kernels, which are not compiled yet.

    Kernels of modules imported earlier are compiled already and are left out.
    """
    global _collected  # noqa: PLW0603 - read by the decorator in each module that is imported
    _collected = found = Kernels()
    try:
        for module in modules:
            importlib.import_module(module)
    finally:
        _collected = None
    return found


def are_cached(kernels: Kernels) -> bool:
    """Return whether all of these kernels that will be loaded are in the cache on disk."""
    return all(_is_cached(each) for each, how in kernels.items() if not how.inner)


def _is_cached(each: Any) -> bool:
    function, (major, minor, *_) = each.py_func, sys.version_info
    line = function.__code__.co_firstlineno
    index = f"*.{function.__qualname__}-{line}.py{major}{minor}*.nbi"
    return any(Path(each.stats.cache_path).glob(index))


def compile_collected(kernels: Kernels) -> None:
    """Compile kernels, or load them from the cache; skip those compiled already.

    Inner kernels are not loaded, only compiled for callers that are not in the cache.
    """
    for each, how in kernels.items():
        if not how.inner:
            _compile_with_callees(each, kernels)


def _compile_with_callees(each: Any, kernels: Kernels) -> None:
    if each.signatures or each not in kernels:
        return
    function = each.py_func
    for name in () if _is_cached(each) else function.__code__.co_names:
        callee = function.__globals__.get(name)
        if isinstance(callee, type(each)):
            _compile_with_callees(callee, kernels)
    for signature in kernels[each].signatures:
        each.compile(signature)
    each.disable_compile()
