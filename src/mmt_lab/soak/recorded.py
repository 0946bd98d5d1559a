"""Whether a recording holds each frame once, and when its frames arrived."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.session.mcap_reader import scanned_frames, utc_offset_ns
from mmt.session.mcap_scan import scan_mcap
from mmt.session.mcap_writer import FRAMES_TOPIC, SESSION_METADATA


@dataclass(frozen=True)
class Gap:
    """Number of missing frames, and the times of the frames before and after them."""

    frames: int
    start_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class Readback:
    """Contents of a recording. Times are seconds of the machine's monotonic clock.

    ``arrival_s`` and ``latency_ms`` (k,) are those of one frame in every block of 20;
    ``disordered`` counts frames whose number is not above the one before.
    """

    whole: bool
    frames: int
    disordered: int
    gaps: tuple[Gap, ...]
    arrival_s: FloatArray
    latency_ms: FloatArray

    @property
    def missing(self) -> int:
        """How many frames are missing."""
        return sum(gap.frames for gap in self.gaps)


def read_back(path: Path) -> Readback:
    """Read a recording of services that ran on this machine."""
    scan = scan_mcap(path)
    blocks = scan.on_topic(FRAMES_TOPIC)
    offset_ns = utc_offset_ns(scan.metadata_of(SESSION_METADATA)) or 0
    arrival_ns = np.array([block.log_time - offset_ns for block in blocks], dtype=np.int64)
    time_ns = np.array([block.publish_time for block in blocks], dtype=np.int64)
    frames = scanned_frames(scan)
    gaps, disordered = find_gaps(frames)
    return Readback(
        whole=scan.whole,
        frames=len(frames),
        disordered=disordered,
        gaps=gaps,
        arrival_s=arrival_ns / 1e9,
        latency_ms=(arrival_ns - time_ns) / 1e6,
    )


def find_gaps(frames: RecordArray) -> tuple[tuple[Gap, ...], int]:
    """Return the gaps between frames (n,), and how many frames do not ascend."""
    sequence, time_ns = frames["sequence"].astype(np.int64), frames["time_ns"].astype(np.int64)
    steps = np.diff(sequence)
    gaps = tuple(
        Gap(int(steps[i]) - 1, float(time_ns[i]) / 1e9, float(time_ns[i + 1]) / 1e9)
        for i in np.flatnonzero(steps > 1)
    )
    return gaps, int(np.count_nonzero(steps <= 0))
