"""Disturbances that spoil a session, and that a good model must tolerate.

Each disturbance returns changed frames of a session. A disturbed moment begins at `MOMENT_S` and
lasts 0.3 s if nothing else is said. Frames are lost throughout the session.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples, samples_per_frame
from mmt.session.data import FRAME_PERIOD_S, sample_times
from mmt.testing.simulation.instruments import ACCELERATION_RANGE_M_S2
from mmt_lab.harness.experiment import names_of

MOMENT_S: Final = 12.0
LASTS_S: Final = 0.3
UNPLUGGED_S: Final = 2.0

_KNOCK_M_S2: Final = 60.0
_KNOCK_S: Final = 0.01
_HUM_M_S2: Final = 5.0
_MAINS_HZ: Final = 50.0
_OVERDRIVE: Final = 100.0
_DRIFT_M_S2: Final = 5.0
_DRIFT_S: Final = 10.0

Spoil = Callable[[RecordArray, np.random.Generator], RecordArray]
"""From frames (n,) and a source of chance to new frames, (n,) or fewer."""

Change = Callable[[FloatArray, FloatArray], None]
"""Changes accelerations (n, 3), given the time since the moment began (n,), s."""


def spoilt(frames: RecordArray, name: str, seed: int) -> RecordArray:
    """Return the frames (n,) of a session, spoilt by one of `SPOILS`; the input is not changed."""
    return SPOILS[name](frames, np.random.default_rng([seed, 28]))


def chosen_spoils(listed: str | None) -> list[str]:
    """Return the names between the commas of ``--spoil``, all of `SPOILS` for ``all``.

    Raises
    ------
    InputError
        A name is none of `SPOILS`.
    """
    names = list(SPOILS) if listed == "all" else names_of(listed)
    unknown = [name for name in names if name not in SPOILS]
    if unknown:
        raise InputError(
            f"--spoil {listed}: {', '.join(unknown)} not known, allowed are all, "
            f"{', '.join(SPOILS)}"
        )
    return names


def _changed(change: Change, frames: RecordArray, _: np.random.Generator) -> RecordArray:
    """Return frames whose acceleration is changed."""
    frame_s = 1e-9 * (frames["time_ns"] - frames["time_ns"][0]) - MOMENT_S
    time_s = sample_times(frame_s, samples_per_frame(frames.dtype), FRAME_PERIOD_S)
    found = frames.copy()
    values = acceleration_samples(frames).astype(np.float64)
    change(values, time_s)
    found["acceleration_m_s2"] = values.reshape(found["acceleration_m_s2"].shape)
    return found


def _during(time_s: FloatArray, lasts_s: float = LASTS_S) -> BoolArray:
    return np.asarray((time_s >= 0.0) & (time_s < lasts_s))


def _vibration(values: FloatArray, inside: BoolArray) -> FloatArray:
    """Return the acceleration of a moment without its mean, which is gravity."""
    return np.asarray(values[inside] - values[inside].mean(axis=0))


def _quieter(by_db: float, values: FloatArray, time_s: FloatArray) -> None:
    inside = _during(time_s)
    values[inside] -= (1.0 - 10.0 ** (-by_db / 20.0)) * _vibration(values, inside)


def _held(values: FloatArray, time_s: FloatArray) -> None:
    inside = np.flatnonzero(_during(time_s))
    values[inside] = values[inside[0]]


def _knocked(values: FloatArray, time_s: FloatArray) -> None:
    inside = _during(time_s, _KNOCK_S)
    values[inside, 2] += _KNOCK_M_S2 * np.sin(np.pi * time_s[inside] / _KNOCK_S)


def _hummed(values: FloatArray, time_s: FloatArray) -> None:
    inside = _during(time_s)
    values[inside] += _HUM_M_S2 * np.sin(2.0 * np.pi * _MAINS_HZ * time_s[inside])[:, None]


def _saturated(values: FloatArray, time_s: FloatArray) -> None:
    inside, limit = _during(time_s), ACCELERATION_RANGE_M_S2
    values[inside] = np.clip(_OVERDRIVE * _vibration(values, inside), -limit, limit)


def _unplugged(values: FloatArray, time_s: FloatArray) -> None:
    values[_during(time_s, UNPLUGGED_S)] = 0.0


def _spiked(values: FloatArray, time_s: FloatArray) -> None:
    values[np.flatnonzero(_during(time_s))[0], 2] += _KNOCK_M_S2


def _drifted(values: FloatArray, time_s: FloatArray) -> None:
    values += (_DRIFT_M_S2 * np.clip(time_s / _DRIFT_S, 0.0, 1.0))[:, None]


def _lost(
    share: float, together: int, frames: RecordArray, random: np.random.Generator
) -> RecordArray:
    """Leave out a share of the frames, `together` in a row each time; the first frame stays."""
    starts = random.random(len(frames)) < share / together
    gone = np.convolve(starts, np.ones(together), "full")[: len(frames)] > 0.0
    gone[0] = False
    return np.asarray(frames[~gone])


_MOMENTS: Final[Mapping[str, Change]] = {
    "quiet-20": partial(_quieter, 20.0),
    "quiet-40": partial(_quieter, 40.0),
    "held": _held,
    "knock": _knocked,
    "hum": _hummed,
    "saturated": _saturated,
    "unplugged": _unplugged,
    "spike": _spiked,
    "drift": _drifted,
}

SPOILS: Final[Mapping[str, Spoil]] = MappingProxyType(
    {name: partial(_changed, change) for name, change in _MOMENTS.items()}
    | {f"lost-{share}": partial(_lost, 0.01 * share, 1) for share in (1, 2, 5)}
    | {f"lost-{share}-in-threes": partial(_lost, 0.01 * share, 3) for share in (1, 2, 5)}
)
"""By name: the vibration, noise and all, 20 and 40 dB quieter; one value repeated; a knock of
60 m/s2 and 10 ms; mains hum of 5 m/s2; the sensor at the ends of its range; 2 s unplugged; one
sample off by 60 m/s2; an offset that drifts by 5 m/s2 in 10 s; 1, 2 and 5 % of the frames lost at
random, one by one or three in a row."""
