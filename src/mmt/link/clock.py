"""Whether two processes read the same monotonic clock."""

import functools
import platform
import uuid
from pathlib import Path
from typing import Final

_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")


@functools.lru_cache(maxsize=1)
def clock_id() -> str:
    """Return a name for the clock that `time.monotonic_ns` reads here.

    Processes with equal names read the same clock, so that their times can be compared. On
    Linux that is the boot and the host; elsewhere, a random name per process, which equals
    no other.
    """
    try:
        boot = _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return f"process-{uuid.uuid4()}"
    return f"{boot}@{platform.node()}"
