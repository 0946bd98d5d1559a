"""Comparison of held-out recorded segments with renderings of a model built without them.

Awan et al., section VII.A: five random samples of the finished model are taken out, the model
is rebuilt without them, and their recorded vibration is compared with what the model
synthesizes at their speed and force.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.model_errors import (
    FELT_HZ,
    WELCH_S,
    band_edges_hz,
    band_errors_db,
    band_membership,
    level_error_db,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.signals.metrics import Spectra, amplitude_spectra, gfc_of_rows
from mmt.texture.synthesis.synthesizer import Synthesizer

HELD_OUT: Final = 5
"""Number of segments taken out; fewer if the model has less than twice as many samples."""

REALISATIONS: Final = 4


@dataclass(frozen=True)
class Approximation:
    """Comparison of one held-out segment with a model's rendering of it.

    ``gfc`` and ``gfc_ceiling`` are means over realisations. ``power_error_db`` compares the
    model's exact power with the segment's mean square, as far as both are felt. ``amplitude`` (f,)
    is the mean amplitude spectrum of the synthesized vibration.
    """

    gfc: float
    gfc_ceiling: float
    power_error_db: float
    amplitude: FloatArray


def _felt_power(vibration_m_s2: FloatArray, rate_hz: float) -> float:
    """Return the mean square of a vibration (n,) up to `FELT_HZ`."""
    frequencies_hz, amplitude = amplitude_spectra(vibration_m_s2, rate_hz, None)
    above = np.square(amplitude[frequencies_hz > FELT_HZ]).sum() * rate_hz / len(vibration_m_s2)
    return float(np.mean(np.square(vibration_m_s2)) - above)


def choose_held_out(segments: Sequence[Segment], seed: int) -> tuple[Segment, ...]:
    """Choose the segments to hold out, in the order of time; the same for the same seed.

    At most half of the segments are taken, so that something is left to build from.
    """
    ordered = sorted(segments, key=lambda segment: (segment.start, segment.stop))
    count = min(HELD_OUT, len(ordered) // 2)
    chosen = np.random.default_rng(seed).choice(len(ordered), size=count, replace=False)
    return tuple(ordered[index] for index in sorted(chosen))


class HeldOutRecording:
    """One held-out segment with its measured spectrum.

    Parameters
    ----------
    segment
        The recorded segment.
    rate_hz
        The sampling rate of its vibration.
    spectra
        Kind of spectra that the GFC compares.
    """

    def __init__(self, segment: Segment, rate_hz: float, spectra: Spectra = Spectra.WELCH) -> None:
        self.segment = segment
        self._rate_hz = rate_hz
        self._window: int | None = None
        if spectra == Spectra.WELCH:
            self._window = min(round(WELCH_S * rate_hz), len(segment.vibration_m_s2))
        self.power = _felt_power(segment.vibration_m_s2, rate_hz)
        self.frequencies_hz, self.amplitude = amplitude_spectra(
            segment.vibration_m_s2, rate_hz, self._window
        )

    def bands_db(self, amplitude: FloatArray) -> FloatArray:
        """Return the errors by bands of an amplitude spectrum (f,), (b,); NaN without a bin."""
        edges_hz = band_edges_hz(self._rate_hz)
        own, measured = (np.square(each)[np.newaxis] for each in (amplitude, self.amplitude))
        errors_db = band_errors_db(own, measured, self.frequencies_hz, edges_hz)[0]
        filled = band_membership(self.frequencies_hz, edges_hz).any(axis=0)
        return np.where(filled, errors_db, np.nan)

    def amplitudes(self, vibration_m_s2: FloatArray) -> FloatArray:
        """Return the amplitude spectra (k, f) of vibrations of the segment's length, (k, n)."""
        return amplitude_spectra(vibration_m_s2, self._rate_hz, self._window)[1]

    def inputs(self, model: TextureModel) -> FloatArray:
        """Return the segment's mean inputs to a model, shape (1, d)."""
        return np.array([self.segment.inputs(model.space)])


def level_errors_db(model: TextureModel, recordings: Sequence[HeldOutRecording]) -> FloatArray:
    """Return the errors in dB of a model's level at held-out segments, at least one, (k,)."""
    inputs = np.concatenate([recording.inputs(model) for recording in recordings])
    return level_error_db(model, inputs, np.array([recording.power for recording in recordings]))


def approximate(
    model: TextureModel, recordings: Sequence[HeldOutRecording], seed: int
) -> list[Approximation]:
    """Compare the recorded vibration of held-out segments with what a model renders in its place.

    For each, one long stretch is rendered at the segment's mean inputs, stationary from its first
    sample, and cut into realisations of the segment's length. The seeds are consecutive.
    """
    errors_db = level_errors_db(model, recordings).tolist() if recordings else []
    return [
        _approximation(model, recording, seed + index, error_db)
        for index, (recording, error_db) in enumerate(zip(recordings, errors_db, strict=True))
    ]


def _approximation(
    model: TextureModel, recording: HeldOutRecording, seed: int, error_db: float
) -> Approximation:
    count = REALISATIONS * len(recording.segment.vibration_m_s2)
    synthesizer = Synthesizer(model, seed=seed, renewal_samples=count, limit_m_s2=np.inf)
    rendered = synthesizer.render(*(np.full(count, value) for value in recording.inputs(model)[0]))
    amplitudes = recording.amplitudes(rendered.reshape(REALISATIONS, -1))
    measured = np.broadcast_to(recording.amplitude, amplitudes.shape)
    return Approximation(
        gfc=float(np.mean(gfc_of_rows(amplitudes, measured))),
        gfc_ceiling=float(np.mean(gfc_of_rows(amplitudes[1:], amplitudes[:-1]))),
        power_error_db=error_db,
        amplitude=amplitudes.mean(axis=0),
    )
