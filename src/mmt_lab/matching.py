"""A matching test by spectra: samples are stroked anew, and models render the same strokes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, get_args

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.session.data import RecordedSession
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import segment
from mmt.texture.settings import Inputs
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.metrics import Spectra, amplitude_spectra, gfc_of_rows, power_error_db
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.selection.concatenated import RATE_HZ, network_settings, stroke
from mmt_methods.selection.points import spectral_error
from mmt_methods.selection.pooling import pool_sessions

RECORDED_S: Final = 30.0
"""Length of the recording for a texture's model; a hand needs it to take all headings."""

STROKED_S: Final = 10.0
"""Length of the stroke on each sample in the matching test."""

RENEWAL_SAMPLES: Final = RATE_HZ // 100
"""Samples between two estimates of the filter: 100 Hz, as in section 3.1 of paper B."""

_WELCH_SAMPLES: Final = 128


@dataclass(frozen=True)
class VirtualTexture:
    """A texture as a model, its model without heading, and the size of the recording."""

    name: str
    model: TextureModel
    of_speed: TextureModel
    recorded_bytes: int

    @property
    def numbers(self) -> int:
        """How many numbers equation 1 has: centres, weights, and a polynomial of degree 1."""
        points, outputs = len(self.model.samples), self.model.order + 1
        inputs = self.model.dimensions
        return points * (inputs + outputs) + (inputs + 1) * outputs


@dataclass(frozen=True, eq=False)
class StrokedSample:
    """A real sample stroked anew.

    ``velocity_mm_s`` (n, 2), ``speed_mm_s`` (n,), ``force_n`` (n,) and ``vibration_m_s2`` (n,) are
    the whole stroke's, at the rate of the vibration; ``segments`` are the parts that are compared.
    """

    name: str
    velocity_mm_s: FloatArray
    speed_mm_s: FloatArray
    force_n: FloatArray
    vibration_m_s2: FloatArray
    segments: tuple[slice, ...]

    def rendered(self, model: TextureModel, seed: int) -> FloatArray:
        """Return what a model renders (n,) under the same stroke."""
        inputs = [self.speed_mm_s] if not model.space.directed else [*self.velocity_mm_s.T]
        synthesizer = Synthesizer(
            model, seed=seed, renewal_samples=RENEWAL_SAMPLES, limit_m_s2=np.inf
        )
        return synthesizer.render(*map(np.ascontiguousarray, inputs), self.force_n)


@dataclass(frozen=True)
class MatchedPair:
    """A real sample and a virtual texture: mean spectral error and GFC, median power error."""

    error: float
    gfc: float
    power_db: float


def virtual_texture(texture: str, seed: int) -> VirtualTexture:
    """Record a texture, and build its models of all segments."""
    frames = stroke(texture, RECORDED_S, seed, directed=True)
    session = RecordedSession(frames, path=Path(texture))
    models: dict[Inputs, TextureModel] = {}
    for inputs in get_args(Inputs):
        pool = pool_sessions([session], network_settings(inputs))
        models[inputs] = pool.model(np.ones(len(pool.data), dtype=np.bool_))
    return VirtualTexture(texture, models["anisotropic"], models["isotropic"], frames.nbytes)


def real_sample(texture: str, seed: int) -> StrokedSample:
    """Stroke a texture anew."""
    settings = network_settings("anisotropic")
    stream = StreamFilter(settings)
    block = stream.process(stroke(texture, STROKED_S, seed, directed=True))
    first, more = int(block.index[0]), settings.samples_per_frame
    velocity, speed, force = (
        np.repeat(channel, more, axis=0)
        for channel in (block.velocity_mm_s, block.speed_mm_s, block.normal_force_n)
    )
    segments = (slice(part.start - first, part.stop - first) for part in segment(block, settings))
    return StrokedSample(
        texture,
        velocity,
        speed,
        force,
        block.vibration_m_s2[:, :, 0].ravel(),
        tuple(slice(part.start * more, part.stop * more) for part in segments),
    )


def compare_pair(
    sample: StrokedSample,
    model: TextureModel,
    seed: int,
    spectra: Spectra,
    recorded: FloatArray | None = None,
) -> MatchedPair:
    """Compare a model's rendering of the stroke with the recording, or another signal if given."""
    rendered = sample.rendered(model, seed)
    recorded = sample.vibration_m_s2 if recorded is None else recorded
    errors, scores, powers_db = [], [], []
    nperseg = _WELCH_SAMPLES if spectra is Spectra.WELCH else None
    for part in sample.segments:
        own, truth = (
            amplitude_spectra(signal[part], RATE_HZ, nperseg)[1] for signal in (rendered, recorded)
        )
        errors.append(float(spectral_error(own, truth)))
        scores.append(float(gfc_of_rows(own, truth)))
        power, true_power = (float(np.mean(signal[part] ** 2)) for signal in (rendered, recorded))
        powers_db.append(power_error_db(power, true_power))
    median_db = float(np.median(np.abs(powers_db)))  # some strokes are silent in the model
    return MatchedPair(float(np.mean(errors)), float(np.mean(scores)), median_db)
