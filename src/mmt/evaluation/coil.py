"""Vibration of an emulated coil against that of the surface at the hand's own motion.

The oracle is the surface's own generator, driven by the hand's speed and the force of robot and
surface at rest at the hand's position, without network, model and actuator. Both vibrations are
evaluated alike. Vibration begins in a touch when its power over 5 ms first exceeds a tenth of the
oracle's mean there, and ends when it last does. Delays are the differences between the two, less
the latency that the output states, as medians over the touches.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import signal

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, MmtError
from mmt.core.files.untrusted import load_arrays
from mmt.evaluation.model_errors import root_mean_square
from mmt.testing.emulated.haptuator import coil_acceleration_m_s2
from mmt.testing.emulated.openhaptics.phantom import series_n_mm
from mmt.testing.simulation.surfaces.known_surfaces import Stroke
from mmt.testing.simulation.surfaces.textures import get_surface

_RATE_HZ: Final = 1000
_POWER_SAMPLES: Final = 5
_THRESHOLD: Final = 0.1
_LONGEST_LATE_S: Final = 0.5
_LEAST_TOUCH_S: Final = 0.15
_LEAST_APART_S: Final = 0.1
_SETTLED_S: Final = 0.5
_BAND_HZ: Final = (10.0, 450.0)


def coil_figures(
    hand: Path, coil: Path, surface: str, robot_n_mm: float, since_s: float, latency_ms: float
) -> dict[str, Any]:
    """Return the figures of a session.

    Parameters
    ----------
    hand, coil
        Files that the emulated handle and the emulated card have written.
    surface
        Name of the surface.
    robot_n_mm
        Stiffness of the robot.
    since_s
        Time before the end at which the vibration began to come from the model.
    latency_ms
        Latency that the output states.

    Raises
    ------
    MmtError
        A file cannot be read, such as one that was cut off.
    """
    try:
        way, played = load_arrays(hand)[0]["way"], load_arrays(coil)[0]
    except InputError as error:
        raise MmtError(f"{hand.name} and {coil.name}: {error}") from error
    rate_hz, start_s = float(played["rate_hz"]), float(played["start_s"])
    felt = coil_acceleration_m_s2(played["volts"].astype(np.float64), rate_hz)
    end_s = min(way[-1, 0], start_s + len(felt) / rate_hz)
    begin_s = max(way[0, 0], start_s, end_s - since_s + _SETTLED_S)
    times_s = np.arange(begin_s, end_s, 1.0 / _RATE_HZ)
    low_pass = signal.butter(6, 480.0, fs=rate_hz, output="sos")
    at_coil = np.interp(
        times_s,
        start_s + np.arange(len(felt)) / rate_hz,
        signal.sosfiltfilt(low_pass, felt),
    )
    velocity = np.column_stack([np.interp(times_s, way[:, 0], way[:, k]) for k in (4, 5)])
    depth_mm = -np.interp(times_s, way[:, 0], way[:, 3])
    force_n = series_n_mm(robot_n_mm) * np.maximum(depth_mm, 0.0)
    oracle, touches = _oracle(surface, velocity, force_n)
    late = round(latency_ms * _RATE_HZ / 1000.0)
    at_coil = np.concatenate([at_coil[late:], np.zeros(late)])
    edges = [_edges(at_coil, oracle, first, last) for first, last in touches]
    found = np.array([edge for edge in edges if edge is not None])
    if not len(found):
        return {"touches": 0, "output_latency_ms": round(latency_ms, 2)}
    begin_ms, end_ms = np.median(found, axis=0).tolist()
    level_db, spectrum_db = _errors_db(np.stack([at_coil, oracle]), touches)
    return {
        "touches": len(found),
        "begin_ms": round(begin_ms, 2),
        "end_ms": round(end_ms, 2),
        "output_latency_ms": round(latency_ms, 2),
        "level_error_db": round(level_db, 2),
        "spectrum_error_db": round(spectrum_db, 2),
    }


def _errors_db(both: FloatArray, touches: list[tuple[int, int]]) -> tuple[float, float]:
    """Return by how much the level in touches differs, and the whole spectrum, of (2, n)."""
    touched = np.concatenate([both[:, first:last] for first, last in touches], axis=1)
    level = np.mean(touched**2, axis=1)
    frequencies, density = signal.welch(both, _RATE_HZ, nperseg=256)
    low, high = _BAND_HZ
    strong = (frequencies >= low) & (frequencies <= high) & (density[1] > 0.01 * density[1].max())
    difference_db = 10.0 * np.log10(density[0, strong] / density[1, strong])
    return float(10.0 * np.log10(level[0] / level[1])), root_mean_square(difference_db)


def _oracle(
    surface: str, velocity_mm_s: FloatArray, force_n: FloatArray
) -> tuple[FloatArray, list[tuple[int, int]]]:
    """Return the vibration at the hand's own motion, and first and last sample of each touch."""
    source = get_surface(surface).vibration(np.random.default_rng(7))
    speed = np.hypot(*velocity_mm_s.T)
    heading = velocity_mm_s / np.maximum(speed, 1e-9)[:, np.newaxis]
    made = np.array(
        [
            source.step(Stroke(s, f, (h[0], h[1])))[0]
            for s, f, h in zip(speed.tolist(), force_n.tolist(), heading.tolist(), strict=True)
        ]
    )
    contact = np.concatenate([[False], force_n > 0.0, [False]])
    changes = np.flatnonzero(np.diff(contact.astype(int)))
    touches = list(zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True))
    apart, least = round(_LEAST_APART_S * _RATE_HZ), round(_LEAST_TOUCH_S * _RATE_HZ)
    clear = [
        (first, last)
        for k, (first, last) in enumerate(touches)
        if last - first >= least
        and first >= apart
        and last <= len(force_n) - 2 * apart
        and (k == 0 or first - touches[k - 1][1] >= apart)
        and (k == len(touches) - 1 or touches[k + 1][0] - last >= apart)
    ]
    return made, clear


def _edges(
    at_coil: FloatArray, oracle: FloatArray, first: int, last: int
) -> tuple[float, float] | None:
    """Return by how much (ms) the coil begins and ends after the oracle, None if one is silent."""
    late = round(_LONGEST_LATE_S * _RATE_HZ)
    begin, end = first - round(_LEAST_APART_S * _RATE_HZ) // 2, last + late
    kernel = np.full(_POWER_SAMPLES, 1.0 / _POWER_SAMPLES)
    power = [np.convolve(each[begin:end] ** 2, kernel, "same") for each in (at_coil, oracle)]
    threshold = _THRESHOLD * np.mean(oracle[first:last] ** 2)
    places = [np.flatnonzero(each > threshold) for each in power]
    if not len(places[0]) or not len(places[1]):
        return None
    (coil_first, coil_last), (own_first, own_last) = ((p[0], p[-1]) for p in places)
    return float(coil_first - own_first), float(coil_last - own_last)
