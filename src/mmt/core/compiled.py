"""The decorator that compiles numerical kernels, caches them and releases the interpreter lock."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

from mmt.core.kernel_cache import drop_stale_kernels

Function = TypeVar("Function", bound=Callable[..., object])

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
        compiled = numba.njit(list(signatures), cache=True, nogil=True, error_model="numpy")
        return cast(Function, compiled(function))

    return decorate
