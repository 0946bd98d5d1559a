"""One place where numerical kernels are compiled, cached and released from the lock."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def drop_stale_kernels(sources: Path) -> bool:
    """Delete the compiled kernels of a folder if any of its sources has changed since.

    numba renews a cached kernel when its own file changes, not when a kernel that it has
    inlined from another file does. Returns whether anything was stale.
    """
    cache = sources / "__pycache__"
    digest = hashlib.sha256()
    for source in sorted(sources.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    stamp = cache / "kernels.sha256"
    with suppress(OSError):
        if stamp.exists() and stamp.read_text() == digest.hexdigest():
            return False
        for compiled in cache.glob("*.nb[ci]"):
            compiled.unlink(missing_ok=True)
        cache.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest())
    return True


drop_stale_kernels(Path(__file__).parent / "texture")


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
