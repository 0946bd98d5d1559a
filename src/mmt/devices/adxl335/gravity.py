"""Calibration by gravity, from readings at rest with each axis pointing up and down.

At rest the sensor measures one g upwards. If an axis points up or down, that axis reads +g or -g
and the two others zero. Readings in a few orientations therefore give a straight line for each
axis: the volts at zero g, and the volts per m/s2.
"""

from collections.abc import Mapping, Sequence
from statistics import linear_regression, median
from typing import Any, Final, Literal, NamedTuple, cast, get_args

from mmt.core.arrays import Vector
from mmt.core.errors import InputError
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.calibrations import finite_vector

Up = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
"""The axis of the sensor that points up."""
UPS: Final[tuple[Up, ...]] = get_args(Up)

_AXES: Final = "xyz"
_MOVED: Final = 0.1
"""Standard deviation (g) from which the sensor counts as moving."""
_SLANT: Final = 0.1
"""Residual (g) from which the sensor counts as tilted: six degrees."""
_GAIN_TOLERANCE: Final = 0.2
"""Relative; the data sheet allows 10 %, the supply adds some."""
_ZERO_TOLERANCE: Final = 1.2
"""In g; the data sheet allows 1 g for Z at 3 V, less for X and Y."""
_CHANGED_ZERO_M_S2: Final = 0.5
_CHANGED_GAIN: Final = 0.02


class Rest(NamedTuple):
    """A reading at rest."""

    up: Up
    """Which axis pointed up."""
    mean_v: Vector
    """Mean of each axis (V)."""
    spread_v: Vector
    """Standard deviation of each axis (V)."""


class GravityCalibration(NamedTuple):
    """Straight lines from volts to m/s2."""

    zero_v: Vector
    """Output of each axis at zero g (V)."""
    gain_v_per_m_s2: Vector
    """Gain of each axis (V per m/s2), above zero."""
    residual_m_s2: float = 0.0
    """Largest distance of a rest from its line; 0 for nominal values."""

    def as_dict(self) -> dict[str, Any]:
        """Return the values as they are stored."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in self._asdict().items()}


def nominal(supply_v: float) -> GravityCalibration:
    """Return the data sheet's values: half the supply at zero g, a tenth of the supply per g."""
    gain = 0.1 * supply_v / GRAVITY_M_S2
    return GravityCalibration((0.5 * supply_v,) * 3, (gain,) * 3)


def from_dict(content: Mapping[str, Any]) -> GravityCalibration:
    """Return a stored calibration.

    Raises
    ------
    InputError
        A value is missing or impossible.
    """
    try:
        zero = finite_vector(content["zero_v"])
        gain = finite_vector(content["gain_v_per_m_s2"])
        residual = float(content["residual_m_s2"])
    except (KeyError, TypeError, ValueError) as error:
        problem = f"the stored calibration cannot be used ({error}): calibrate again"
        raise InputError(problem) from error
    if not all(1e-6 < value < 1e3 for value in gain) or not all(abs(v) < 1e3 for v in zero):
        raise InputError("the stored calibration has impossible values: calibrate again")
    return GravityCalibration(zero, gain, residual)


def rests_from(content: object) -> list[Rest]:
    """Return recorded rests: a list of ``{"up", "mean_v", "spread_v"}``.

    Raises
    ------
    InputError
        The content is no such list.
    """
    try:
        rests = [
            Rest(
                cast(Up, item["up"]), finite_vector(item["mean_v"]), finite_vector(item["spread_v"])
            )
            for item in cast(list[dict[str, Any]], content)
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            'rests must be a list of {"up": "+x", "mean_v": [x, y, z], "spread_v": [x, y, z]}; '
            f"there is a problem at {error}"
        ) from error
    for rest in rests:
        if rest.up not in UPS:
            raise InputError(f"rest {rest.up!r}: 'up' must be one of {', '.join(UPS)}")
    return rests


def calibrate(rests: Sequence[Rest], supply_v: float) -> GravityCalibration:
    """Fit zero and gain of each axis, by least squares over all rests.

    Parameters
    ----------
    rests
        Each axis must have pointed up or down at least once, and at least three orientations
        must differ; all six are best, since they reveal a tilt.
    supply_v
        The sensor's supply (V); zero and gain must fit it.

    Raises
    ------
    InputError
        The rests do not determine the calibration, or contradict each other or the data sheet;
        the message names the rest or the axis, and the likely reason.
    """
    missing = [axis for axis in _AXES if not any(rest.up[1] == axis for rest in rests)]
    if missing or len({rest.up for rest in rests}) < 3:
        raise InputError(
            f"no rest with {', '.join(missing)} up or down: every axis needs one, six are best"
        )
    for rest in rests:
        check_still(rest, supply_v)
    _check_orientations(rests)
    lines = [_line(rests, axis) for axis in range(3)]
    for axis, (zero, gain) in enumerate(lines):
        _check_line(_AXES[axis], zero, gain, supply_v)
    residual = 0.0
    for rest in rests:
        for axis, (zero, gain) in enumerate(lines):
            off = abs(rest.mean_v[axis] - zero - gain * _felt(rest.up, axis)) / gain
            residual = max(residual, off)
            if off > _SLANT * GRAVITY_M_S2:
                raise InputError(
                    f"with {rest.up} up, {_AXES[axis]} is {off:.2f} m/s2 off its line: the sensor "
                    "was held at a slant, or something pushed it; put it against a right angle "
                    "and measure again"
                )
    zeros, gains = [zero for zero, _ in lines], [gain for _, gain in lines]
    return GravityCalibration(finite_vector(zeros), finite_vector(gains), residual)


def check_still(rest: Rest, supply_v: float) -> None:
    """Raise `InputError` if the sensor moved during the rest."""
    spread_g = max(rest.spread_v) / (0.1 * supply_v)
    if not spread_g < _MOVED:
        raise InputError(
            f"with {rest.up} up the sensor was not at rest (it varied by {spread_g:.2f} g): put it "
            "down, do not hold it in the hand, and measure again"
        )


def changes(new: GravityCalibration, old: GravityCalibration) -> list[str]:
    """Return a sentence for each axis whose zero or gain has clearly changed."""
    sentences = []
    for axis, name in enumerate(_AXES):
        zero = (new.zero_v[axis] - old.zero_v[axis]) / old.gain_v_per_m_s2[axis]
        gain = new.gain_v_per_m_s2[axis] / old.gain_v_per_m_s2[axis] - 1.0
        if abs(zero) > _CHANGED_ZERO_M_S2 or abs(gain) > _CHANGED_GAIN:
            sentences.append(
                f"{name}: zero moved by {zero:+.2f} m/s2, gain by {100 * gain:+.1f} %: another "
                "sensor, another supply or reference voltage, or a knock"
            )
    return sentences


def _felt(up: Up, axis: int) -> float:
    if up[1] != _AXES[axis]:
        return 0.0
    return GRAVITY_M_S2 if up[0] == "+" else -GRAVITY_M_S2


def _line(rests: Sequence[Rest], axis: int) -> tuple[float, float]:
    """Return (zero, gain) of one axis."""
    felt = [_felt(rest.up, axis) for rest in rests]
    gain, zero = linear_regression(felt, [rest.mean_v[axis] for rest in rests])
    return zero, gain


def _check_orientations(rests: Sequence[Rest]) -> None:
    """Raise `InputError` if a rest looks like another orientation than the one named."""
    zero = [median(rest.mean_v[axis] for rest in rests) for axis in range(3)]
    for rest in rests:
        off = [rest.mean_v[axis] - zero[axis] for axis in range(3)]
        axis = max(range(3), key=lambda a: abs(off[a]))
        seen = ("+" if off[axis] > 0 else "-") + _AXES[axis]
        if seen != rest.up:
            raise InputError(
                f"the rest named {rest.up} up looks like {seen} up: the sensor lay otherwise, or "
                "its outputs are connected in another order"
            )


def _check_line(name: str, zero: float, gain: float, supply_v: float) -> None:
    share = gain * GRAVITY_M_S2 / (0.1 * supply_v)
    if abs(share - 1.0) > _GAIN_TOLERANCE:
        raise InputError(
            f"{name} gives {gain * GRAVITY_M_S2:.3f} V per g where a supply of {supply_v:g} V "
            f"means {0.1 * supply_v:.3f}: check the options for supply, reference and resolution"
        )
    off_g = abs(zero - 0.5 * supply_v) / (0.1 * supply_v)
    if off_g > _ZERO_TOLERANCE:
        raise InputError(
            f"{name} gives {zero:.3f} V at zero g where a supply of {supply_v:g} V means "
            f"{0.5 * supply_v:.3f}: check the options for supply and reference, and the wiring"
        )
