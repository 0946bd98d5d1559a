"""Pool samples of several trials: from sessions, with their segments, or from saved models."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.core.errors import InputError, MmtError
from mmt.core.files.untrusted import load_arrays
from mmt.session.data import RecordedSession
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import Segment, segment
from mmt.texture.settings import ModellingSettings
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
        samples = self.samples
        return TextureModel(
            TextureSamples(
                samples.inputs[kept],
                samples.lsf[kept],
                samples.variance[kept],
                samples.power[kept],
                samples.space,
            ),
            method=self.settings.method,
            rate_hz=self.settings.vibration_rate_hz,
        )


def pool_sessions(sessions: Sequence[RecordedSession], settings: ModellingSettings) -> Pool:
    """Segment whole sessions, and fit all segments at one common order.

    Raises
    ------
    MmtError
        There are no steady strokes.
    """
    space = InputSpace(settings.inputs)
    segments: list[Segment] = []
    origin: list[str] = []
    for session in sessions:
        stream = StreamFilter(settings)
        found = segment(stream.process(session.frames), settings)
        found = [part for part in found if part.vibration_m_s2.any()]
        segments += found
        origin += [str(session.path)] * len(found)
    if not segments:
        raise MmtError("too few steady strokes: there is no segment to select from")
    vibration = [part.vibration_m_s2 for part in segments]
    fits = burg_batch(vibration, settings.filter_order)
    samples = TextureSamples(
        np.array([part.inputs(space) for part in segments]),
        reflection_to_lsf(fits.reflection),
        fits.variances[:, -1],
        fits.variances[:, 0],
        space,
    )
    data = ModelPoints(
        samples.points, samples.lsf, samples.variance, vibration, settings.vibration_rate_hz
    )
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
    inputs, lsf, variance, power = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("inputs", "lsf", "variance", "power")
    )
    samples = TextureSamples(inputs, lsf, variance, power, first.space)
    settings = ModellingSettings(
        method=first.method, inputs=first.space.name, rate_hz=first.rate_hz
    )
    data = ModelPoints(
        samples.points, samples.lsf, samples.variance, rate_hz=settings.vibration_rate_hz
    )
    origin = [name for name, part in zip(names, parts, strict=True) for _ in range(len(part))]
    return Pool(samples, data, tuple(origin), settings)


_KEYS: Final = ("spectral_error", "gfc", "power_error_db")


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
        figures = (
            spectral_error(estimate, truth).mean(),
            gfc_of_rows(estimate, truth).mean(),
            np.sqrt(np.mean(power_db**2)),
        )
        result[name] = dict(zip(_KEYS, map(float, figures), strict=True))
    return result


def is_model(path: Path) -> bool:
    """Return whether a file is a texture model, by its content."""
    if path.suffix.lower() != ".npz":
        return False
    try:
        return "lsf_rad" in load_arrays(path, lambda _: False)[1]
    except (OSError, InputError) as error:
        raise InputError(f"{path}: {error}") from error
