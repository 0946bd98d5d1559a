"""What the filters give out: aligned channels, their noise floor, and the faults of the signals.

While the tool is in the air or at rest, the signal behind the high-pass is the sensor's own noise,
and now and then a knock or the robot's motion. The lower quartile of the power of short windows is
the noise to some tenths (25th percentile of 50 squares of white noise: 0.87 of its power), as long
as a quarter of the windows holds nothing else. It is too low rather than too high.
"""

import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Self

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, IntArray

WINDOW: Final = 50
"""Frames of a window, which is used whole or not at all."""

LEAST_WINDOWS: Final = 4
"""Least windows from which the noise is estimated."""

WINDOWS_KEPT: Final = 200
"""Number of newest windows from which the noise is estimated."""

_IN_AIR_N: Final = 0.05
_AT_REST_MM_S: Final = 3.0


@dataclass(frozen=True, eq=False)
class Columns:
    """Arrays of one length, (n, ...) each; an index takes the same part of every array."""

    def __getitem__(self, part: slice | BoolArray) -> Self:
        return type(self)(*(column[part] for column in vars(self).values()))

    @classmethod
    def concatenate(cls, blocks: Sequence[Self]) -> Self:
        """Join successive blocks, at least one."""
        columns = zip(*(vars(block).values() for block in blocks), strict=True)
        return cls(*map(np.concatenate, columns))


@dataclass(frozen=True, eq=False)
class AlignedBlock(Columns):
    """Filtered channels that belong to the same instants, one element a frame.

    ``index`` (n,) is the frame's sequence number, strictly ascending, with jumps where
    frames are missing; ``time_ns`` (n,) its time. ``position_mm`` (n, 3) is low-passed.
    ``velocity_mm_s`` (n, 2) is the velocity in the plane orthogonal to the normal axis,
    along its two axes in their order, ``speed_mm_s`` (n,) its magnitude.
    ``normal_force_n`` (n,) is positive when pressing, else 0. ``vibration_m_s2`` is high-
    passed, k samples a frame: (n, k, 1) for an axis and (n, k, 3) for DFT321, which is applied to
    whole segments.
    ``valid`` (n,) is False while the filters settle after a gap, and where the acceleration is no
    measurement and is not filled. ``measured`` (n,) is False where it is no measurement, filled or
    not; filled samples are valid, but count for nothing.
    """

    index: IntArray
    time_ns: IntArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    speed_mm_s: FloatArray
    normal_force_n: FloatArray
    vibration_m_s2: FloatArray
    valid: BoolArray
    measured: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    @classmethod
    def empty(cls) -> Self:
        """Return a block of no samples."""
        number, none = np.zeros(0, np.int64), np.zeros(0)
        rows = (np.zeros((0, 3)), np.zeros((0, 2)), none, none, np.zeros((0, 1, 1)))
        return cls(number, number, *rows, none > 0.0, none > 0.0)


class NoiseFloor:
    """Noise power of an accelerometer, from its newest windows without contact or motion."""

    def __init__(self) -> None:
        self._powers: deque[float] = deque(maxlen=WINDOWS_KEPT)

    def update(self, block: AlignedBlock) -> None:
        """Add a block of the stream."""
        count = len(block) // WINDOW
        if not count:
            return
        part = block[: count * WINDOW]
        power = np.square(part.vibration_m_s2).sum(axis=2).reshape(count, -1).mean(axis=1)
        still = part.normal_force_n.reshape(count, WINDOW).max(axis=1) < _IN_AIR_N
        still |= part.speed_mm_s.reshape(count, WINDOW).max(axis=1) < _AT_REST_MM_S
        still &= part.valid.reshape(count, WINDOW).all(axis=1) & np.isfinite(power)
        self._powers.extend(power[still].tolist())

    @property
    def power(self) -> float:
        """Noise power in (m/s2)^2, 0 with fewer than `LEAST_WINDOWS` windows."""
        if len(self._powers) < LEAST_WINDOWS:
            return 0.0
        return statistics.quantiles(self._powers, n=4, method="inclusive")[0]


def dft321(vibration_m_s2: FloatArray) -> FloatArray:
    """Reduce three axes to one signal of the same spectrum and energy.

    People do not feel the direction of a vibration above some 60 Hz, but its spectrum. In
    each bin of the discrete Fourier transform the result has the magnitude
    sqrt(|X|^2 + |Y|^2 + |Z|^2) and the phase of X + Y + Z (Landin, Romano, McMahan and
    Kuchenbecker, "Dimensional reduction of high-frequency accelerations for haptic
    rendering", EuroHaptics 2010). The sum of squares is kept to rounding.

    The transform needs a whole stretch, so this is applied to each segment before it is
    fitted, not to the stream. Its window is the segment itself.

    Parameters
    ----------
    vibration_m_s2
        Shape (n, 3), n >= 0.

    Returns
    -------
    FloatArray
        Shape (n,). O(n log n): about 60 us for 1000 samples.
    """
    samples = len(vibration_m_s2)
    if samples == 0:
        return np.zeros(0)
    spectra = np.fft.rfft(vibration_m_s2, axis=0)
    magnitude = np.sqrt((spectra.real**2 + spectra.imag**2).sum(axis=1))
    together = spectra.sum(axis=1)
    length = np.abs(together)
    # Where the axes cancel there is no phase to take; zero is as good as any.
    phase = np.divide(together, length, out=np.ones_like(together), where=length > 0.0)
    reduced: FloatArray = np.fft.irfft(magnitude * phase, n=samples)
    return reduced


_ACCELEROMETER: Final = {
    "held_s": "held one value for",
    "saturated_s": "was saturated for",
    "constant_s": "gave one value from the start for",
}
_JUDGED: Final = (*_ACCELEROMETER, "not_finite_s")
_FRAMES: Final = {"missing_s": "missing for", "not_finite_s": "not finite for"}


@dataclass(frozen=True)
class SignalFaults:
    """Seconds whose acceleration was no measurement, by cause, and seconds that were filled.

    ``missing_s``: frames that did not come. ``not_finite_s``: frames with a number that is not
    finite, or beyond `bridging.LARGEST_MEASUREMENT`, in a channel that is used. The other causes
    are those of `mmt.texture.signals.validity`, counted at the output of the filter. ``bridged_s``:
    filled frames, whatever the cause. ``throughout``: whether all acceleration so far was constant.
    """

    held_s: float = 0.0
    saturated_s: float = 0.0
    constant_s: float = 0.0
    not_finite_s: float = 0.0
    missing_s: float = 0.0
    bridged_s: float = 0.0
    throughout: bool = False

    def sentence(self) -> str:
        """Return the causes with their seconds, "" without a fault."""
        if self.throughout:
            parts = ["the accelerometer gave one value throughout"]
        else:
            parts = self._in_words("the accelerometer ", _ACCELEROMETER)
        parts += self._in_words("frames were ", _FRAMES)
        if self.bridged_s > 0.0:
            parts.append(f"{_seconds(self.bridged_s)} of this filled in")
        return "; ".join(parts)

    def since(self, before: "SignalFaults") -> "SignalFaults":
        """Return the faults of the acceleration since an earlier count."""
        seconds = {name: max(0.0, getattr(self, name) - getattr(before, name)) for name in _JUDGED}
        return SignalFaults(**seconds, throughout=self.throughout)

    def should_report(self, reported: "SignalFaults") -> bool:
        """Return whether the seconds of a cause have at least doubled since they were reported.

        Missing frames do not count here, as they are reported as lost. Nor does a fault that was
        reported as lasting throughout and still does.
        """
        seconds = [(getattr(self, name), getattr(reported, name)) for name in _JUDGED]
        doubled = any(now > 0.0 and now >= 2.0 * before for now, before in seconds)
        return doubled and not (self.throughout and reported.throughout)

    def as_dict(self) -> dict[str, Any]:
        """Return the seconds by cause, and the sentence, for a program."""
        table = asdict(self)
        del table["throughout"]
        return {**{name: round(value, 6) for name, value in table.items()}, "text": self.sentence()}

    def _in_words(self, whose: str, words: dict[str, str]) -> list[str]:
        """Return the words for these causes, or nothing if none has occurred."""
        values = {text: getattr(self, name) for name, text in words.items()}
        found = [f"{text} {_seconds(value)}" for text, value in values.items() if value > 0.0]
        return [whose + ", ".join(found)] if found else []


def _seconds(value: float) -> str:
    return f"{value:.3g} s" if value < 100.0 else f"{value:.0f} s"
