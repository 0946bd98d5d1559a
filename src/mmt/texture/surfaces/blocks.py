"""Blocks of a tenth of a second of the stream: mean inputs, and power in frequency bands.

Surfaces are recognised by blocks. A block is 100 consecutive samples of steady contact. Its
spectrum is estimated with sine tapers (Riedel and Sidorenko, "Minimum bias multiple taper
spectral estimation", IEEE Trans. Signal Processing 43(1), 1995) and added up in nine bands of
50 Hz, from 15 to 465 Hz. The logarithm of a band's power is nearly normal with a spread that
does not depend on the level: about that of a chi-square of twice the number of independent
frequencies.

The first hundredths of a second of contact are left out, and so are blocks within which speed or
force changes by more than a factor of two: their spectrum belongs to no one speed.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.signals.aligned import AlignedBlock

BLOCK: Final = 100
"""Number of samples of a block."""

BANDS: Final = 9
"""Number of bands of its spectrum."""

_TAPERS: Final = 3
_FIRST_BIN: Final = 2  # of 10 Hz
_BINS: Final = 5
_CELL: Final = 10
_MARGIN: Final = 20
_LARGEST_CHANGE: Final = 2.0
_LEAST_POWER: Final = 1e-12
"""Least power in (m/s2)^2: a stuck sensor measures none at all."""

SPEED_MM_S, FORCE_N = 100.0, 1.0
"""Where the logarithms of speed and of force are zero."""


@dataclass(frozen=True, eq=False)
class SurfaceBlock:
    """Features of one block.

    ``start`` and ``stop`` are absolute sample numbers, half-open. ``inputs`` (2,) or (4,): the
    logarithms of the speed over 100 mm/s and of the force over 1 N, and for textures that
    depend on it cosine and sine of the heading. ``log_power`` (`BANDS`,): natural logarithm of
    the power in each band in (m/s2)^2. ``touchdown``: the first one after the tool met a
    surface. ``contact_start``: the sample number at which this contact began.
    """

    start: int
    stop: int
    inputs: FloatArray
    log_power: FloatArray
    touchdown: bool
    contact_start: int


class BlockCutter:
    """Cut a stream of aligned samples into blocks, update by update.

    Cost: about 0.1 ms a block.

    Parameters
    ----------
    least_speed_mm_s, least_force_n
        Slower or lighter samples belong to no block; contact is what is pressed harder than
        half of that force.
    by_heading
        Whether the heading is one of a block's inputs.
    """

    def __init__(
        self,
        least_speed_mm_s: float = 10.0,
        least_force_n: float = 0.1,
        *,
        by_heading: bool = False,
    ) -> None:
        self._least_speed_mm_s = least_speed_mm_s
        self._least_force_n = least_force_n
        self._by_heading = by_heading
        self._rest = AlignedBlock.empty()
        self._next = -1
        self._contact_start = 0
        self._touching = False
        self._fresh = True
        self._cells: list[AlignedBlock] = []

    def cut(self, aligned: AlignedBlock) -> list[SurfaceBlock]:
        """Add the next samples, any number of them, and return the blocks they complete."""
        if len(self._rest) and len(aligned):
            aligned = AlignedBlock.concatenate([self._rest, aligned])
        found: list[SurfaceBlock] = []
        whole = len(aligned) // _CELL * _CELL if len(aligned) else 0
        for begin in range(0, whole, _CELL):
            block = self._add_cell(aligned[begin : begin + _CELL])
            if block is not None:
                found.append(block)
        if len(aligned):
            self._rest = aligned[whole:]
        return found

    def _add_cell(self, cell: AlignedBlock) -> SurfaceBlock | None:
        """Add a cell of ten samples; return the block that it completes, if any."""
        start, stop = int(cell.index[0]), int(cell.index[-1]) + 1
        whole = stop - start == _CELL and bool(cell.valid.all())
        if start != self._next or not whole:
            self._cells = []
        self._next = stop
        touching = bool((cell.normal_force_n > 0.5 * self._least_force_n).all())
        if touching and not self._touching:
            self._contact_start, self._fresh = start, True
        self._touching = touching
        steady = (
            whole
            and touching
            and start >= self._contact_start + _MARGIN
            and bool((cell.speed_mm_s >= self._least_speed_mm_s).all())
            and bool((cell.normal_force_n >= self._least_force_n).all())
        )
        if not steady:
            self._cells = []
            return None
        self._cells.append(cell)
        self._drop_what_differs()
        if len(self._cells) * _CELL < BLOCK:
            return None
        return self._finish()

    def _drop_what_differs(self) -> None:
        """Drop the oldest cells where speed or force has changed too much since them."""
        for values in ("speed_mm_s", "normal_force_n"):
            means = np.array([getattr(cell, values).mean() for cell in self._cells])
            ratio = means / means[-1]
            apart = np.flatnonzero((ratio > _LARGEST_CHANGE) | (ratio < 1.0 / _LARGEST_CHANGE))
            if len(apart):
                self._cells = self._cells[int(apart[-1]) + 1 :]

    def _finish(self) -> SurfaceBlock:
        samples = AlignedBlock.concatenate(self._cells)
        self._cells = []
        touchdown, self._fresh = self._fresh, False
        return SurfaceBlock(
            start=int(samples.index[0]),
            stop=int(samples.index[-1]) + 1,
            inputs=self._inputs(samples),
            log_power=band_log_power(samples.vibration_m_s2),
            touchdown=touchdown,
            contact_start=self._contact_start,
        )

    def _inputs(self, samples: AlignedBlock) -> FloatArray:
        place = [
            float(np.log(samples.speed_mm_s / SPEED_MM_S).mean()),
            float(np.log(samples.normal_force_n / FORCE_N).mean()),
        ]
        if self._by_heading:
            x, y = samples.velocity_mm_s.mean(axis=0)
            length = max(float(np.hypot(x, y)), np.finfo(np.float64).tiny)
            place += [float(x) / length, float(y) / length]
        return np.array(place)


def band_log_power(vibration_m_s2: FloatArray) -> FloatArray:
    """Return the logarithms of a block's power in each band, shape (`BANDS`,).

    Parameters
    ----------
    vibration_m_s2
        Shape (`BLOCK`, 1), or (`BLOCK`, 3) where the powers of three axes are added.
    """
    spectra = np.fft.rfft(_tapers()[:, :, None] * vibration_m_s2[None], axis=1)
    density = (spectra.real**2 + spectra.imag**2).sum(axis=2).mean(axis=0)
    used = density[_FIRST_BIN : _FIRST_BIN + BANDS * _BINS].reshape(BANDS, _BINS)
    power = 2.0 / BLOCK * used.sum(axis=1)
    return np.asarray(np.log(np.maximum(power, _LEAST_POWER)), dtype=np.float64)


@cache
def _tapers() -> FloatArray:
    """Return the sine tapers, shape (tapers, `BLOCK`), each of unit energy."""
    order = np.arange(1, _TAPERS + 1)[:, None]
    place = np.arange(1, BLOCK + 1)[None, :]
    tapers: FloatArray = np.sqrt(2.0 / (BLOCK + 1)) * np.sin(np.pi * order * place / (BLOCK + 1))
    tapers.setflags(write=False)
    return tapers
