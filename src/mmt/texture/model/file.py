"""The ``.npz`` file of a texture model; the layout is in ``docs/reference/model-file.md``."""

from dataclasses import astuple
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.bounds import real_numbers
from mmt.core.errors import InputError
from mmt.texture.field.cells import FELT_POWER, FieldCells
from mmt.texture.model.file_arrays import Arrays, file_arrays
from mmt.texture.settings import Method
from mmt.texture.space import InputSpace, TextureSamples

if TYPE_CHECKING:
    from mmt.texture.touch_down.transient import Transient

_LARGEST_WHOLE: Final = 2**31

_LARGEST_POWER: Final = 1e12
"""Largest power of a file, in (m/s2)^2: 1e6 m/s2, a thousand times what accelerometers measure."""
FORMAT_VERSION: Final = 7
"""Version of a file. Versions 1 to 6 name the parts of a method and are read as the nearest method.
Their blocks are gathered by place, and each place is read as one moment."""


class ModelContents(NamedTuple):
    """Contents of a model file: the parameters of `TextureModel`, not checked here."""

    samples: TextureSamples
    method: Method
    rate_hz: float
    field: FieldCells | None = None
    touch_down: "Transient | None" = None


def unpack(data: bytes) -> ModelContents:
    """Return the contents of a model from its file, written now or in an earlier version.

    Raises
    ------
    InputError
        The data is no model, has an unknown version, or an array is missing or out of its range.
    """
    return contents_of(file_arrays(data))


def arrays_of(contents: ModelContents) -> Arrays:
    """Return a model as the arrays of a file, by name."""
    samples, field, space = contents.samples, contents.field, contents.samples.space
    touch_down = contents.touch_down
    arrays = {
        "format_version": np.int64(FORMAT_VERSION),
        "method": np.str_(contents.method),
        "inputs": np.str_(space.name),
        **dict(zip(space.channels, samples.inputs.T, strict=True)),
        "lsf_rad": samples.lsf,
        "variance": samples.variance,
        "power": samples.power,
        "maximum_speed_mm_s": np.float64(space.maximum_speed_mm_s),
        "maximum_force_n": np.float64(space.maximum_force_n),
        "rate_hz": np.float64(contents.rate_hz),
        "effective_samples": samples.effective,
        "segment_samples": samples.counts,
        "noise_power": np.array(samples.noise_power) if samples.noise_power > 0.0 else None,
        "field_cells": None if field is None else field.keys.astype(np.int32),
        "field_sums": None if field is None else field.sums,
        "field_moment_blocks": None if field is None else np.int64(field.moment_blocks),
        "touch_down_shapes": None if touch_down is None else touch_down.shapes,
        "touch_down_speed_mm_s": None if touch_down is None else touch_down.speeds_mm_s,
        "touch_down_law": None if touch_down is None else np.array(astuple(touch_down.law)),
    }
    return {name: array for name, array in arrays.items() if array is not None}


def contents_of(arrays: Arrays) -> ModelContents:
    """Return the contents of a model from the arrays of a file.

    Raises
    ------
    InputError
        The version is unknown, or an array is missing or out of its range.
    """
    content = dict(arrays)
    try:
        method, has_blocks = _method(content)
        space = InputSpace(
            str(content["inputs"]),  # type: ignore[arg-type] # checked by the class
            _number(content, "maximum_speed_mm_s"),
            _number(content, "maximum_force_n"),
        )
        samples = TextureSamples(
            space.stack(*(content[name] for name in space.channels)),
            content["lsf_rad"],
            content["variance"],
            content["power"],
            space,
            _numbers(content, "effective_samples"),
            _number(content, "noise_power", 0.0),
            _numbers(content, "segment_samples"),
        )
        _check_powers(samples)
        field = _field(content, directed=space.directed) if has_blocks else None
        rate_hz = _number(content, "rate_hz")
        return ModelContents(samples, method, rate_hz, field, _touch_down(content))
    except InputError:  # SettingError is a ValueError too
        raise
    except KeyError as error:
        raise InputError(f"not a texture model: the array {error} is missing") from error
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        raise InputError(f"its arrays do not fit together: {error}") from error


def _method(content: Arrays) -> tuple[Method, bool]:
    """Return the method of a file, and whether the method can use the file's blocks.

    Earlier versions name what is interpolated and how, and from version 4 on the kind of level and
    shape. Linearly interpolated variances, or those of a network over velocity and force, are read
    as published, anything else as the field. Blocks of a file with measured shapes are of the
    vibration behind the high-pass, and are not used.
    """
    version = _number(content, "format_version")
    if version not in range(1, FORMAT_VERSION + 1):
        raise InputError(f"version is {version:g}, this mmt reads 1 to {FORMAT_VERSION}: update it")
    if version == FORMAT_VERSION:
        return cast(Method, str(content["method"])), "field_cells" in content
    if version == 1:
        content.update(inputs=np.array("isotropic"), interpolator=np.array("delaunay"))
    own = "network" if str(content["inputs"]) == "anisotropic" else "delaunay"
    parts = str(content["interpolate"]), str(content["interpolator"])
    measured = str(content.get("shape", "measured")) == "measured"
    if parts == ("variance", own) and measured:
        return "published", False
    return "field", "field_cells" in content and not measured


def _check_powers(samples: TextureSamples) -> None:
    for name in ("variance", "power"):
        if not (real_numbers(name, getattr(samples, name)) <= _LARGEST_POWER).all():
            raise InputError(f"{name} must be finite, at most {_LARGEST_POWER:g} (m/s2)^2")


def _numbers(content: Arrays, name: str) -> FloatArray | None:
    return real_numbers(name, content[name]) if name in content else None


def _number(content: Arrays, name: str, usual: float | None = None) -> float:
    value = content[name] if usual is None else content.get(name, np.array(usual))
    if value.shape != ():
        raise InputError(f"{name} has shape {value.shape}: one number is needed")
    return float(real_numbers(name, value))


def _whole(name: str, values: npt.ArrayLike) -> IntArray:
    numbers = real_numbers(name, values)
    if not (np.abs(numbers) < _LARGEST_WHOLE).all() or (numbers != np.rint(numbers)).any():
        raise InputError(f"{name} must be whole numbers")
    return numbers.astype(np.int64)


def _field(content: Arrays, *, directed: bool) -> FieldCells:
    keys = _whole("field_cells", content["field_cells"])
    sums = real_numbers("field_sums", content["field_sums"])
    if "field_moment_blocks" not in content:
        keys, sums = _by_moment(keys, sums)
    if keys.ndim != 2 or keys.shape[1] != 4 or sums.shape != (len(keys), 4) or not len(keys):
        raise InputError(
            f"field_cells has shape {keys.shape} and field_sums {sums.shape}: "
            "(r, 4) and (r, 4) needed"
        )
    blocks = _whole("field_moment_blocks", _number(content, "field_moment_blocks", 1))
    field = FieldCells(directed, keys, sums, int(blocks))
    field.check()
    if not (field.sums[:, 1] <= _LARGEST_POWER * np.minimum(field.sums[:, 0], 1e6)).all():
        raise InputError(f"field_sums holds a mean power above {_LARGEST_POWER:g} (m/s2)^2")
    return field


def _touch_down(content: Arrays) -> "Transient | None":
    if "touch_down_shapes" not in content:
        return None
    from mmt.texture.touch_down.transient import Law, Transient

    shapes, speeds, law = (
        real_numbers(name, content[name])
        for name in ("touch_down_shapes", "touch_down_speed_mm_s", "touch_down_law")
    )
    if law.shape != (5,):
        raise InputError(f"touch_down_law has shape {law.shape}: (5,) is needed")
    return Transient(speeds, shapes, Law(*law.tolist()))


def _by_moment(keys: IntArray, sums: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the rows, gathered by place, of a file of version 6, with each place as a moment."""
    if keys.ndim != 2 or keys.shape[1] != 5 or sums.shape != (len(keys), 4):
        return keys, sums
    count, power, first, second = sums.T
    felt = np.log1p(FELT_POWER * count / power)  # approximate rise of each logarithm
    squares = second + 2.0 * felt * first + count * np.square(felt)
    rows = np.column_stack([keys[:, :3], np.arange(len(keys))])
    summed = [count, power + FELT_POWER * count, first + count * felt, squares]
    return rows, np.column_stack(summed)
