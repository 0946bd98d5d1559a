"""Knocks on the table that a tool strokes on: simulated ones, and recorded ones."""

from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.untrusted import parse_xml

RATE_HZ: Final = 1000.0
KNOCK_S: Final = 0.4
SAMPLES: Final = round(KNOCK_S * RATE_HZ)
SHARE: Final = 0.4
"""Variance of the knock over that of the segment (paper C, equation 3)."""

_LATEST: Final = 0.7  # share of a segment in which a knock begins
_LEAD: Final = 10
_TAP_STEP: Final = 10  # samples at 10 kHz


def simulated_knock(generator: np.random.Generator, rate_hz: float = RATE_HZ) -> FloatArray:
    """Return two to four modes of a table struck at once, 0.4 s at a rate.

    Frequencies 30 to 300 Hz, decay times 10 to 60 ms, amplitudes and phases at random.
    """
    time_s = np.arange(round(KNOCK_S * rate_hz)) / rate_hz
    knock = np.zeros(len(time_s))
    for _ in range(int(generator.integers(2, 5))):
        frequency = generator.uniform(30.0, 300.0)
        decay_s = generator.uniform(0.01, 0.06)
        phase = generator.uniform(0.0, 2.0 * np.pi)
        tone = np.sin(2.0 * np.pi * frequency * time_s + phase)
        knock += generator.normal() * np.exp(-time_s / decay_s) * tone
    return knock


def add_knock(segment: FloatArray, knock: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Return a segment (n,) with the part of a knock that falls into it; see `placed_knock`."""
    start, placed = placed_knock(segment, knock, generator)
    struck = segment.copy()
    struck[start : start + len(placed)] += placed[: len(segment) - start]
    return struck


def placed_knock(
    segment: FloatArray, knock: FloatArray, generator: np.random.Generator, share: float = SHARE
) -> tuple[int, FloatArray]:
    """Place a knock within the first 70 % of a segment (n,), and scale it.

    It becomes ``N sigma_a / sigma_n sqrt(share)``, with both deviations over the segment.

    Returns
    -------
    start
        Index in the segment at which the knock begins.
    placed : (k,)
        The knock, which may ring beyond the segment's end.
    """
    start = int(generator.integers(0, max(1, int(_LATEST * len(segment)))))
    inside = np.zeros(len(segment))
    part = knock[: len(segment) - start]
    inside[start : start + len(part)] = part
    return start, np.asarray(knock * (segment.std() / inside.std() * np.sqrt(share)))


def read_taps(path: Path) -> list[FloatArray]:
    """Return the taps on a material of the Penn toolkit, each of shape (SAMPLES,).

    A file ``Taps_MATERIAL.xml`` holds accelerations of 10 ms at 10 kHz (``tap/tapAccel/value``),
    which are brought to 1 kHz and high-passed at 10 Hz.
    """
    from scipy.signal import butter, resample_poly, sosfilt

    try:
        root = parse_xml(path.read_bytes())
        rows = [[float(v.text or "") for v in tap.iter("value")] for tap in root.iter("tapAccel")]
    except (OSError, InputError, ValueError) as error:
        raise InputError(f"taps {path}: no taps of the Penn toolkit: {error}") from error
    if not rows or not all(1 < len(row) < _TAP_STEP * (SAMPLES - _LEAD) for row in rows):
        raise InputError(f"taps {path}: needs tap/tapAccel with values at 10 kHz")
    taps = np.zeros((len(rows), _TAP_STEP * SAMPLES))
    for tap, row in zip(taps, rows, strict=True):
        tap[_TAP_STEP * _LEAD :][: len(row)] = row
    sections = butter(2, 10.0, "highpass", fs=RATE_HZ, output="sos")
    return list(sosfilt(sections, resample_poly(taps, 1, _TAP_STEP, axis=1)))
