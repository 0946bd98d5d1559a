"""Whether two processes read the same monotonic clock."""

import functools
import platform
import uuid
from pathlib import Path
from typing import Final

_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_OFFSETS: Final = Path("/proc/self/timens_offsets")


@functools.lru_cache(maxsize=1)
def clock_id() -> str:
    """Return a name for the clock that `time.monotonic_ns` reads here.

    Processes with equal names read the same clock, so that their times can be compared. On
    Linux that is the boot, the host, and the offset of a time namespace, as containers may
    have; elsewhere, a random name per process, which equals no other.
    """
    try:
        boot = _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return f"process-{uuid.uuid4()}"
    return f"{boot}@{platform.node()}{_namespace_offset()}"


def _namespace_offset() -> str:
    """Return what a time namespace adds to the monotonic clock, nothing where there is none."""
    try:
        lines = _OFFSETS.read_text(encoding="ascii").splitlines()
    except OSError:
        return ""
    for words in (line.split() for line in lines):
        if len(words) == 3 and words[0] == "monotonic" and words[1:] != ["0", "0"]:
            return f"+{words[1]}.{words[2]}"
    return ""
