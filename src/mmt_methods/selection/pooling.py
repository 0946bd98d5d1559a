"""Pool samples of several trials: from sessions, with their segments, or from saved models."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.core.errors import InputError, MmtError, naming
from mmt.core.files.untrusted import load_arrays
from mmt.session.data import RecordedSession
from mmt.texture.model.fits import Fit, fit_segments, unpacked
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import NoiseFloor
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.metrics import gfc_of_rows
from mmt.texture.space import InputSpace, TextureSamples
from mmt_methods.selection import ModelPoints
from mmt_methods.selection.points import amplitude_of, enclose, enclose_without, spectral_error


@dataclass(frozen=True)
class Pool:
    """Samples of one texture from several sessions or models.

    ``data`` holds the samples as points, with their segments if they come from sessions;
    ``origin`` names the source of each; ``settings`` are those to build a model with.
    """

    samples: TextureSamples
    data: ModelPoints
    origin: tuple[str, ...]
    settings: ModellingSettings

    def model(self, kept: BoolArray) -> TextureModel:
        """Return the model of the samples in the mask `kept`, shape (n,)."""
        chosen = {name: rows[kept] for name, rows in _rows_of([self.samples]).items()}
        samples = replace(self.samples, **chosen)
        settings = self.settings
        return TextureModel(samples, method=settings.method, rate_hz=settings.vibration_rate_hz)


def _rows_of(parts: Sequence[TextureSamples]) -> dict[str, Any]:
    """Return the joined rows of samples by name, without those that a part does not know."""
    names = ("inputs", "lsf", "variance", "power", "effective", "counts")
    columns = {name: [getattr(part, name) for part in parts] for name in names}
    known = {name: rows for name, rows in columns.items() if all(row is not None for row in rows)}
    return {name: np.concatenate(rows) for name, rows in known.items()}


def pool_sessions(sessions: Sequence[RecordedSession], settings: ModellingSettings) -> Pool:
    """Segment whole sessions, and fit all segments at one common order.

    Samples are as the settings' method has them, points as the segments are, behind the high-pass.

    Raises
    ------
    MmtError
        There are no steady strokes.
    """
    fitted: list[Fit] = []
    origin: list[str] = []
    numbers, noise = count(), NoiseFloor()
    for session in sessions:
        aligned = StreamFilter(settings).process(session.frames)
        noise.update(aligned)
        found = [part for part in segment(aligned, settings) if part.vibration_m_s2.any()]
        fits = fit_segments(found, numbers, settings)
        fitted += fits
        origin += [str(session.path)] * len(fits)
    if not fitted:
        raise MmtError("too few steady strokes: there is no segment to select from")
    samples = unpacked([fit.packed for fit in fitted], InputSpace(settings.inputs))
    samples = replace(samples, noise_power=noise.power)
    vibration = [fit.segment.vibration_m_s2 for fit in fitted]
    order, rate_hz = settings.filter_order, settings.vibration_rate_hz
    data = ModelPoints.fitted(samples.points, vibration, order, rate_hz)
    return Pool(samples, data, tuple(origin), settings)


def pool_models(models: Sequence[TextureModel], names: Sequence[str]) -> Pool:
    """Put the samples of saved models together.

    Raises
    ------
    InputError
        The models differ in order, in rate or in their inputs, or a sample has no variance.
    """
    first = models[0]
    for model, name in zip(models, names, strict=True):
        for what, mine, theirs in (
            ("order", first.order, model.order),
            ("rate", first.rate_hz, model.rate_hz),
            ("inputs", first.space, model.space),
        ):
            if mine != theirs:
                raise InputError(
                    f"model {name}: its {what} is {theirs}, that of {names[0]} {mine}; "
                    "name models that agree, or the sessions that they were built from"
                )
    parts = [model.samples for model in models]
    noise_power = min(part.noise_power for part in parts)
    samples = TextureSamples(**_rows_of(parts), space=first.space, noise_power=noise_power)
    settings = ModellingSettings(
        method=first.method, inputs=first.space.name, rate_hz=first.rate_hz
    )
    data = ModelPoints(
        samples.points, samples.lsf, samples.variance, rate_hz=settings.vibration_rate_hz
    )
    origin = [name for name, part in zip(names, parts, strict=True) for _ in range(len(part))]
    return Pool(samples, data, tuple(origin), settings)


def left_out_errors(
    data: ModelPoints, outlier: BoolArray, kept: BoolArray
) -> dict[str, dict[str, float] | int]:
    """Compare the models before and after a selection at the places of the good points.

    A point in a model is predicted without that point. The model before has the outliers in it.

    Returns
    -------
    dict
        ``before`` and ``after``: mean relative spectral error, mean GFC of the filters'
        exact amplitude spectra, rms of the power error in dB. ``places``: how many places
        both models can predict.
    """
    values = np.column_stack([data.lsf, data.variance])
    before = enclose_without(data.points).interpolate(values)
    after = enclose(data.points[kept], data.points).interpolate(values[kept])
    after[kept] = enclose_without(data.points[kept]).interpolate(values[kept])
    places = np.flatnonzero(np.isfinite(before[:, 0] + after[:, 0]) & ~outlier)
    result: dict[str, dict[str, float] | int] = {"places": len(places)}
    if not len(places):
        return result
    count = data.frequencies
    truth = amplitude_of(data.lsf[places], data.variance[places], count)
    for name, predicted in (("before", before[places]), ("after", after[places])):
        estimate = amplitude_of(predicted[:, :-1], predicted[:, -1], count)
        power_db = 10.0 * np.log10((estimate**2).mean(axis=1) / (truth**2).mean(axis=1))
        result[name] = {
            "spectral_error": float(spectral_error(estimate, truth).mean()),
            "gfc": float(gfc_of_rows(estimate, truth).mean()),
            "power_error_db": float(np.sqrt(np.mean(power_db**2))),
        }
    return result


def is_model(path: Path) -> bool:
    """Return whether a file is a texture model, by its content."""
    if path.suffix.lower() != ".npz":
        return False
    with naming(path):
        return "lsf_rad" in load_arrays(path, lambda _: False)[1]
