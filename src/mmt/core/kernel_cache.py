"""The cache of compiled kernels on disk; nothing is compiled here."""

import hashlib
from contextlib import suppress
from pathlib import Path
from typing import Final

KERNELS: Final = Path(__file__).parents[1] / "texture"
"""Folder of the kernels' sources; numba caches compiled code in folders beside them."""


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
