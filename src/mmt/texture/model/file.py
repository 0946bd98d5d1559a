"""The ``.npz`` file of a texture model; the layout is in ``docs/reference/model-file.md``."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.texture.field.cells import FELT_POWER, FieldCells
from mmt.texture.field.trend import NO_TREND, Trend
from mmt.texture.interpolation.interpolator import State
from mmt.texture.model.file_arrays import Arrays, file_arrays, pack_arrays
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.settings import CHANNELS

FORMAT_VERSION: Final = 7
"""Version of a file in which level or shape are estimates of their own. Version 6, whose
blocks are gathered by place, is read too, as are versions 4 and 5, without blocks, version 2,
without what was fitted, and version 1, whose models are isotropic and by Delaunay."""

INTERPOLATED_VERSION: Final = 3
"""Version of a file in which both are interpolated, as earlier programs render it."""

_OWN: Final = frozenset(
    (
        *("format_version", "inputs", "lsf_rad", "variance", "power", "rate_hz", "interpolate"),
        *("interpolator", "level", "shape", "effective_samples", "segment_samples"),
        *("maximum_speed_mm_s", "maximum_force_n", "noise_power"),
        *("trend_exponents", "level_hyperparameters"),
        *("field_cells", "field_sums", "field_place_mm", "field_moment_blocks"),
        *(channel for channels in CHANNELS.values() for channel in channels),
    )
)
"""Arrays of the model; all others are the interpolator's state."""


@dataclass(frozen=True, eq=False)
class FittedParameters:
    """Parameters that a model has fitted to its samples, by which it is built again as it is.

    Fitting the exponents anew costs little, choosing the networks' settings most of what building
    them takes; and a model that has grown may have been given its own at fewer samples than it
    has.

    Attributes
    ----------
    trend
        The power law over which its level is interpolated, `NO_TREND` for an isotropic one.
    interpolator_state
        What the interpolator stores of itself, by the arrays' names in a model file.
    """

    trend: Trend
    interpolator_state: State


@dataclass(frozen=True, eq=False)
class ModelContents:
    """What a model file holds: the parameters of `TextureModel`, which are not checked here."""

    samples: TextureSamples
    interpolate: str
    interpolator: str
    level: str
    shape: str
    rate_hz: float
    fitted: FittedParameters | None
    field: FieldCells | None = None


def pack(contents: ModelContents) -> bytes:
    """Return a model as the content of a file."""
    return pack_arrays(arrays_of(contents))


def unpack(data: bytes) -> ModelContents:
    """Return the contents of a model from what `pack` returned, now or in an earlier version.

    Raises
    ------
    InputError
        It is no model, has another version, lacks an array, or one is out of its range.
    """
    return contents_of(file_arrays(data))


def arrays_of(contents: ModelContents) -> Arrays:
    """Return a model as the arrays of a file, by name."""
    samples, space = contents.samples, contents.samples.space
    return {
        "format_version": np.int64(_written_version(contents)),
        "inputs": np.str_(space.name),
        **dict(zip(space.channels, samples.inputs.T, strict=True)),
        "lsf_rad": samples.lsf,
        "variance": samples.variance,
        "power": samples.power,
        "maximum_speed_mm_s": np.float64(space.maximum_speed_mm_s),
        "maximum_force_n": np.float64(space.maximum_force_n),
        "rate_hz": np.float64(contents.rate_hz),
        "interpolate": np.str_(contents.interpolate),
        "interpolator": np.str_(contents.interpolator),
        **_level_arrays(contents),
        **_fitted_arrays(contents.fitted, directed=space.directed),
        **_field_arrays(contents.field),
    }


def contents_of(arrays: Arrays) -> ModelContents:
    """Return the contents of a model from the arrays of a file.

    Raises
    ------
    InputError
        The version is another one, an array is missing, or one is out of its range.
    """
    content = dict(arrays)
    try:
        version = _version(content)
        space = InputSpace(
            str(content["inputs"]),  # type: ignore[arg-type] # checked by the class
            float(content["maximum_speed_mm_s"]),
            float(content["maximum_force_n"]),
        )
        samples = TextureSamples(
            space.stack(*(content[name] for name in space.channels)),
            content["lsf_rad"],
            content["variance"],
            content["power"],
            space,
            _numbers(content, "effective_samples"),
            float(content.get("noise_power", 0.0)),
            _numbers(content, "segment_samples"),
        )
        estimated = version > INTERPOLATED_VERSION
        return ModelContents(
            samples,
            str(content["interpolate"]),
            str(content["interpolator"]),
            str(content["level"]) if estimated else "interpolated",
            str(content["shape"]) if estimated else "measured",
            float(content["rate_hz"]),
            _fitted(content, directed=space.directed) if version > 2 else None,
            _field(content, directed=space.directed),
        )
    except KeyError as error:
        raise InputError(f"the array {error} is missing") from error
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        raise InputError(f"its arrays do not fit together: {error}") from error


def _version(content: Arrays) -> int:
    """Return the version of a file, whose arrays are completed where it is the first."""
    version = int(content.get("format_version", 0))
    if not 1 <= version <= FORMAT_VERSION:
        raise InputError(f"format version is {version}, this program reads 1 to {FORMAT_VERSION}")
    if version == 1:
        content.update(inputs=np.array("isotropic"), interpolator=np.array("delaunay"))
    return version


def _numbers(content: Arrays, name: str) -> FloatArray | None:
    return np.asarray(content[name], dtype=np.float64) if name in content else None


def _written_version(contents: ModelContents) -> int:
    plain = contents.level == "interpolated" and contents.shape == "measured"
    plain &= contents.field is None
    return INTERPOLATED_VERSION if plain else FORMAT_VERSION


def _level_arrays(contents: ModelContents) -> Arrays:
    arrays: Arrays = {}
    samples = contents.samples
    if samples.effective is not None:
        arrays["effective_samples"] = samples.effective
    if samples.counts is not None:
        arrays["segment_samples"] = samples.counts
    if samples.noise_power > 0.0:
        arrays["noise_power"] = np.array(samples.noise_power)
    if _written_version(contents) == FORMAT_VERSION:
        arrays.update(level=np.array(contents.level), shape=np.array(contents.shape))
    return arrays


def _fitted_arrays(fitted: FittedParameters | None, *, directed: bool) -> Arrays:
    arrays: Arrays = {}
    if fitted is None:
        return arrays
    if directed:
        arrays["trend_exponents"] = np.array(fitted.trend)
    taken = sorted(_OWN & fitted.interpolator_state.keys())
    if taken:
        message = f"an interpolator's state has the names of the model's own arrays: {taken}"
        raise ValueError(message)
    arrays.update(fitted.interpolator_state)
    return arrays


def _field_arrays(field: FieldCells | None) -> Arrays:
    if field is None:
        return {}
    return {
        "field_cells": field.keys.astype(np.int32),
        "field_sums": field.sums,
        "field_moment_blocks": np.int64(field.moment_blocks),
    }


def _field(content: Arrays, *, directed: bool) -> FieldCells | None:
    if "field_cells" not in content:
        return None
    keys, sums = content["field_cells"].astype(np.int64), content["field_sums"].astype(np.float64)
    if "field_moment_blocks" not in content:
        keys, sums = _by_moment(keys, sums)
    if keys.ndim != 2 or keys.shape[1] != 4 or sums.shape != (len(keys), 4) or not len(keys):
        raise InputError(
            f"field_cells has shape {keys.shape} and field_sums {sums.shape}: "
            "(r, 4) and (r, 4) needed"
        )
    field = FieldCells(directed, keys, sums, int(content.get("field_moment_blocks", 1)))
    field.check()
    return field


def _by_moment(keys: IntArray, sums: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the rows of a file of version 6, by place, as if each place were a moment."""
    if keys.ndim != 2 or keys.shape[1] != 5 or sums.shape != (len(keys), 4):
        return keys, sums
    count, power, first, second = sums.T
    felt = np.log1p(FELT_POWER * count / power)  # what each logarithm rises by, about
    squares = second + 2.0 * felt * first + count * np.square(felt)
    rows = np.column_stack([keys[:, :3], np.arange(len(keys))])
    summed = [count, power + FELT_POWER * count, first + count * felt, squares]
    return rows, np.column_stack(summed)


def _fitted(content: Arrays, *, directed: bool) -> FittedParameters:
    trend = NO_TREND
    if directed:
        trend = Trend(*content["trend_exponents"].astype(np.float64).tolist())
        if trend != NO_TREND:
            trend.check()
    state = {name: array for name, array in content.items() if name not in _OWN}
    return FittedParameters(trend, state)
