"""The time of a block of vibration, of several generators in turns."""

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter_ns
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.generators.guarded import GeneratorFault, GuardedGenerator
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt_lab.compare.rendered_spectra import BLOCK_SAMPLES, RATE_HZ
from mmt_lab.compare.time_limit import time_limit

TIMED_S: Final = 10.0
"""The last of the session's own strokes, along which blocks are timed."""

LONGEST_BLOCK_S: Final = 5.0


def block_times_us(
    sources: Mapping[str, GuardedGenerator], motion: FloatArray, seed: int
) -> tuple[dict[str, FloatArray], dict[str, GeneratorFault]]:
    """Return the time of each block of 10 ms by name, and what ended the timing of others.

    All take turns, block by block, so that they meet the same machine.

    Parameters
    ----------
    sources
        By name.
    motion
        Speed, velocity x and y, and force at each sample, shape (4, n).
    seed
        What they begin with.
    """
    found: dict[str, list[int]] = {name: [] for name in sources}
    faults: dict[str, GeneratorFault] = {}
    for start in range(0, motion.shape[1], BLOCK_SAMPLES):
        block = motion[:, start : start + BLOCK_SAMPLES]
        for name in list(found):
            source = sources[name]
            inputs = block[1:] if source.directed else block[[0, 3]]
            late = f"generator {name}: a block of 10 ms took longer than {LONGEST_BLOCK_S:g} s"
            try:
                with time_limit(LONGEST_BLOCK_S, late):
                    if start == 0:
                        source.reset(seed)
                    found[name].append(_timed(source.render, inputs))
            except GeneratorFault as fault:
                faults[name] = fault
                del found[name]
    return {name: np.array(times) * 1e-3 for name, times in found.items()}, faults


def last_motion(blocks: Sequence[RecordArray], settings: ModellingSettings) -> FloatArray:
    """Return a session's last speeds, velocities x and y, and forces, shape (4, n)."""
    stream = StreamFilter.of(settings)
    aligned = stream.process(np.concatenate(list(blocks)))
    count = min(len(aligned), round(TIMED_S * RATE_HZ)) // BLOCK_SAMPLES * BLOCK_SAMPLES
    rows = (aligned.speed_mm_s, *aligned.velocity_mm_s.T, aligned.normal_force_n)
    return np.array(rows)[:, len(aligned) - count :]


def _timed(render: Callable[..., object], inputs: FloatArray) -> int:
    """Return the nanoseconds of a call."""
    started = perf_counter_ns()
    render(*inputs)
    return perf_counter_ns() - started
