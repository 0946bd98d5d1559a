"""Vibration as an Apple Haptic and Audio Pattern (.ahap): strength and sharpness over time.

After Apple's "Representing haptic patterns in AHAP files" (Core Haptics). A pattern holds no
waveform for the actuator, but the level and the mean frequency at each moment. It can also name a
sound file, which is heard and not felt.
"""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.existing import write_file
from mmt_bridges.haptics.effects import EffectFile, checked_full_scale

_STEP_S: Final = 0.02
_LONGEST_EVENT_S: Final = 30.0  # of a continuous event, by Apple's text
_MOST_POINTS: Final = 16
"""Most points of one curve: players ignore points after the sixteenth."""

_DULLEST_HZ: Final = 65.0
"""Frequency of sharpness 0; `_SHARPEST_HZ` is that of sharpness 1. Apple gives none: both are from
the encoder of MPEG's reference software for haptics."""

_SHARPEST_HZ: Final = 300.0


def write_ahap(
    path: Path | str,
    samples_m_s2: FloatArray,
    rate_hz: int,
    full_scale_m_s2: float | None = None,
    *,
    sound: str | None = None,
) -> EffectFile:
    """Write the level and mean frequency of vibration, every 20 ms, as a pattern.

    Parameters
    ----------
    path
        The file; replaced if it exists.
    samples_m_s2
        Shape (n,), finite, n at least 1.
    rate_hz
        Sampling rate.
    full_scale_m_s2
        Amplitude of the sine that an intensity of 1 stands for; larger ones are clipped. By
        default the largest amplitude.
    sound
        Name of a sound file beside the pattern, to be played with it.

    Raises
    ------
    InputError
        There are no samples, the full scale is not positive, or the file cannot be written.
    """
    if not len(samples_m_s2):
        raise InputError("no vibration to write: the motion is too short")
    times_s, amplitude, frequency_hz = moments(samples_m_s2, rate_hz)
    full_scale = checked_full_scale(full_scale_m_s2, float(amplitude.max()))
    seconds = len(samples_m_s2) / rate_hz
    sharpness = (frequency_hz - _DULLEST_HZ) / (_SHARPEST_HZ - _DULLEST_HZ)
    pattern = [
        *_events(seconds),
        *_curves("HapticIntensityControl", times_s, amplitude / full_scale),
        *_curves("HapticSharpnessControl", times_s, sharpness),
    ]
    if sound is not None:
        event = _event("AudioCustom", 0.0, AudioVolume=1.0)
        pattern.append({"Event": {**event, "EventWaveformPath": sound}})
    document = {"Version": 1.0, "Pattern": pattern}
    write_file(Path(path), json.dumps(document, separators=(",", ":"), allow_nan=False))
    return EffectFile(seconds, full_scale)


def moments(samples: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the level and the mean frequency of a waveform, every 20 ms and at its end.

    These are times in s, amplitudes of the sine of the same power, and mean frequencies of the
    power spectrum in Hz (0 for silence); shapes (k,), k at least 2. The windows are Hann windows
    of 40 ms, cut off at the ends of the waveform.
    """
    step = max(1, round(_STEP_S * rate_hz))
    centres = [*range(0, len(samples), step), len(samples)]
    taper = np.hanning(2 * step + 1)
    frequencies_hz = np.fft.rfftfreq(2 * step + 1, 1.0 / rate_hz)
    found = np.zeros((len(centres), 2))
    for index, centre in enumerate(centres):
        first = max(0, centre - step)
        part = samples[first : centre + step + 1]
        weight = taper[first - centre + step :][: len(part)]
        spectrum = np.abs(np.fft.rfft(part * weight, 2 * step + 1)) ** 2
        found[index, 0] = np.sqrt(2.0 * (part**2 @ weight) / weight.sum())
        found[index, 1] = spectrum @ frequencies_hz / (spectrum.sum() or 1.0)
    return np.array(centres) / rate_hz, found[:, 0], found[:, 1]


def _events(seconds: float) -> list[dict[str, Any]]:
    starts = np.arange(0.0, seconds, _LONGEST_EVENT_S)
    events = []
    for start in starts.tolist():
        event = _event("HapticContinuous", start, HapticIntensity=1.0, HapticSharpness=0.0)
        event["EventDuration"] = min(_LONGEST_EVENT_S, seconds - start)
        events.append({"Event": event})
    return events


def _event(kind: str, time_s: float, **parameters: float) -> dict[str, Any]:
    listed = [{"ParameterID": name, "ParameterValue": value} for name, value in parameters.items()]
    return {"Time": time_s, "EventType": kind, "EventParameters": listed}


def _curves(parameter: str, times_s: FloatArray, values: FloatArray) -> list[dict[str, Any]]:
    """Return curves through the values, clipped to 0 and 1; each begins where the last one ends.

    A curve of intensity multiplies the intensity of the event, which is 1. A curve of sharpness is
    added to the sharpness of the event, which is 0.
    """
    clipped = np.clip(values, 0.0, 1.0).tolist()
    points = [
        (round(time_s, 6), round(value, 5))
        for time_s, value in zip(times_s.tolist(), clipped, strict=True)
    ]
    curves = []
    for first in range(0, len(points) - 1, _MOST_POINTS - 1):
        begin_s = points[first][0]
        listed = [
            {"Time": round(time_s - begin_s, 6), "ParameterValue": value}
            for time_s, value in points[first : first + _MOST_POINTS]
        ]
        curve = {"ParameterID": parameter, "Time": begin_s, "ParameterCurveControlPoints": listed}
        curves.append({"ParameterCurve": curve})
    return curves
