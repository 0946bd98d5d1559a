"""Recorded human motion and force as the stroke of a simulated session."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError, naming
from mmt.core.files.untrusted import load_arrays
from mmt.testing.simulation import PERIOD_S, RATE_HZ

MOTION_BAND_HZ: Final = 40.0
"""Human motion ends well below this frequency; noise of an encoder's steps lies mostly above."""

LARGEST_SCALE: Final = 100.0

_HALF_WIDTH_S: Final = 0.05
_LEAST_DURATION_S: Final = 0.2
_LARGEST_GAP_SHARE: Final = 2.0


@dataclass(frozen=True)
class RecordedPath:
    """A stroke at the session's rate.

    Attributes
    ----------
    position_mm
        Shape (n, 3); z as recorded, or zero if the recording has no height.
    force_n
        Normal force, shape (n,), at least 0.
    name
        The file's name.
    """

    position_mm: FloatArray
    force_n: FloatArray
    name: str

    def scaled(self, motion_scale: float, force_scale: float) -> "RecordedPath":
        """Return the path with larger or smaller motion and force.

        Raises
        ------
        InputError
            A scale is not above 0 and at most `LARGEST_SCALE`.
        """
        for name, scale in (("motion_scale", motion_scale), ("force_scale", force_scale)):
            if not 0.0 < scale <= LARGEST_SCALE:
                raise InputError(
                    f"{name} is {scale}, it must be above 0 and at most {LARGEST_SCALE:g}"
                )
        return RecordedPath(motion_scale * self.position_mm, force_scale * self.force_n, self.name)

    def looped(self, count: int) -> "RecordedPath":
        """Return `count` samples: to a turn near the end, back to one near the start, and so on.

        The turns are the slowest samples of the first and the last quarter, so that position,
        speed and force do not jump there, and velocity hardly does.
        """
        if count <= len(self.force_n):
            return self._taken(np.arange(count))
        return self._taken(np.fromiter(self.endless(), np.int64, count))

    def endless(self) -> Iterator[int]:
        """Yield indices of samples without end, from the first on, in the order of `looped`."""
        step_mm = np.hypot(*np.diff(self.position_mm[:, :2], axis=0).T)
        quarter = max(1, len(self.force_n) // 4)
        first = int(np.argmin(step_mm[:quarter]))
        last = len(self.force_n) - quarter + int(np.argmin(step_mm[-quarter:]))
        yield from range(last)
        while True:
            yield from range(last, first, -1)
            yield from range(first, last)

    def _taken(self, index: IntArray) -> "RecordedPath":
        return RecordedPath(self.position_mm[index], self.force_n[index], self.name)


def load_path(path: Path) -> RecordedPath:
    """Read a recorded stroke and bring it to the session's rate.

    Parameters
    ----------
    path
        An ``.npz`` file, either with ``time_s`` (n,), ``position_mm`` (n, 3), ``force_n``
        (n, 3) with the normal force as z; or with ``time_s``, ``follower_position_rad``,
        ``environment_torque_nm`` and ``arm_length_m`` of a lever. The lever's tip moves
        along x, and the magnitude of its force is the normal force.

    Raises
    ------
    InputError
        The file cannot be read, an array is missing or misshapen, a number is not
        finite, time does not rise, or the recording is too short.
    """
    with naming(f"path {path}"):
        arrays, _ = load_arrays(path)
        time_s, position_mm, force_n = _tool(arrays) or _lever(arrays)
        _check(time_s, position_mm, force_n)
        return RecordedPath(
            _resampled(time_s, position_mm, MOTION_BAND_HZ),
            np.maximum(_resampled(time_s, force_n, 0.4 * RATE_HZ), 0.0),
            path.name,
        )


def _array(arrays: Mapping[str, Any], name: str) -> FloatArray:
    try:
        return np.asarray(arrays[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"array {name} holds no numbers") from error


def _tool(arrays: Mapping[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    if not {"time_s", "position_mm", "force_n"} <= arrays.keys():
        return None
    force_n = _array(arrays, "force_n")
    if force_n.ndim != 2 or force_n.shape[1] != 3:
        raise InputError(f"force_n has shape {force_n.shape}, it must be (n, 3)")
    return _array(arrays, "time_s"), _array(arrays, "position_mm"), force_n[:, 2]


def _lever(arrays: Mapping[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    needed = ("time_s", "follower_position_rad", "environment_torque_nm", "arm_length_m")
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise InputError(
            f"array {missing[0]} is missing; needed are time_s, position_mm and force_n, "
            f"or {', '.join(needed)}"
        )
    time_s, angle_rad, torque_nm, arm_m = (_array(arrays, name) for name in needed)
    if angle_rad.ndim != 1 or arm_m.size != 1 or not float(arm_m.ravel()[0]) > 0.0:
        raise InputError("follower_position_rad must be (n,) and arm_length_m one number above 0")
    arm = float(arm_m.ravel()[0])
    position_mm = np.zeros((angle_rad.size, 3))
    position_mm[:, 0] = 1000.0 * arm * angle_rad
    return time_s, position_mm, np.abs(torque_nm) / arm


def _check(time_s: FloatArray, position_mm: FloatArray, force_n: FloatArray) -> None:
    count = time_s.size
    if time_s.shape != (count,) or position_mm.shape != (count, 3) or force_n.shape != (count,):
        raise InputError(
            f"shapes of time {time_s.shape}, position {position_mm.shape} and force "
            f"{force_n.shape} do not fit each other"
        )
    for name, values in (("time_s", time_s), ("position", position_mm), ("force", force_n)):
        if not np.isfinite(values).all():
            raise InputError(f"{name} holds a number that is not finite")
    if count < 2 or not (np.diff(time_s) > 0.0).all():
        raise InputError("time_s must rise from sample to sample")
    if time_s[-1] - time_s[0] < _LEAST_DURATION_S:
        raise InputError(f"the recording is shorter than {_LEAST_DURATION_S:g} s")
    missing = (time_s[-1] - time_s[0]) / float(np.median(np.diff(time_s))) / count
    if missing > _LARGEST_GAP_SHARE:
        raise InputError("time_s has gaps longer than what was recorded")


def _resampled(time_s: FloatArray, values: FloatArray, band_hz: float) -> FloatArray:
    """Return values (n,) or (n, c) at the session's rate, limited to a band.

    The recording is laid on an even grid of its own median rate (or the session's, if
    that is higher), filtered by a windowed-sinc low-pass of no delay, and read off every
    session period. Lost samples are bridged by straight lines.
    """
    period = min(float(np.median(np.diff(time_s))), PERIOD_S)
    grid = np.arange(0.0, time_s[-1] - time_s[0], period)
    wanted = np.arange(0.0, grid[-1], PERIOD_S)
    taps = _low_pass(band_hz * period, round(_HALF_WIDTH_S / period))
    columns = values.reshape(len(values), -1).T
    result = [
        np.interp(wanted, grid, _filtered(np.interp(grid, time_s - time_s[0], column), taps))
        for column in columns
    ]
    return np.stack(result, axis=-1).reshape(len(wanted), *values.shape[1:])


def _low_pass(cutoff: float, half_width: int) -> FloatArray:
    """Return a Blackman-windowed sinc of 2 h + 1 taps; `cutoff` in cycles a sample."""
    if cutoff >= 0.5:
        return np.ones(1)
    place = np.arange(-half_width, half_width + 1)
    taps = np.sinc(2.0 * cutoff * place) * np.blackman(2 * half_width + 3)[1:-1]
    return np.asarray(taps / taps.sum(), dtype=np.float64)


def _filtered(column: FloatArray, taps: FloatArray) -> FloatArray:
    """Filter with the ends mirrored through their own value, so that nothing jumps there."""
    half = taps.size // 2
    before = 2.0 * column[0] - column[half:0:-1]
    after = 2.0 * column[-1] - column[-2 : -half - 2 : -1]
    return np.convolve(np.concatenate([before, column, after]), taps, mode="valid")
