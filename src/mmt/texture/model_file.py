"""The ``.npz`` file of a texture model; the layout is in ``docs/reference/model-file.md``."""

import io
import zipfile
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.errors import InputError
from mmt.texture.inputs import InputSpace
from mmt.texture.samples import TextureSamples

if TYPE_CHECKING:
    from mmt.texture.model import TextureModel

FORMAT_VERSION: Final = 2
"""Of what is written. Version 1, whose models are isotropic and by Delaunay, is read too."""


def pack(model: "TextureModel") -> bytes:
    """Return a model as the content of a file."""
    samples, space = model.samples, model.space
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        format_version=np.int64(FORMAT_VERSION),
        inputs=np.str_(space.name),
        **dict(zip(space.channels, samples.inputs.T, strict=True)),
        lsf_rad=samples.lsf,
        variance=samples.variance,
        power=samples.power,
        maximum_speed_mm_s=np.float64(space.maximum_speed_mm_s),
        maximum_force_n=np.float64(space.maximum_force_n),
        rate_hz=np.float64(model.rate_hz),
        interpolate=np.str_(model.interpolate),
        interpolator=np.str_(model.interpolator),
    )
    return buffer.getvalue()


def unpack(data: bytes) -> tuple[TextureSamples, dict[str, Any]]:
    """Return the samples and the settings of a model from what `pack` returned.

    Raises
    ------
    InputError
        It is no model, has another version, or lacks an array.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            content = {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError("not a texture model (.npz), or cut off") from error
    version = int(content.get("format_version", 0))
    if not 1 <= version <= FORMAT_VERSION:
        raise InputError(f"format version is {version}, this program reads 1 to {FORMAT_VERSION}")
    if version == 1:
        content.update(inputs=np.str_("isotropic"), interpolator=np.str_("delaunay"))
    try:
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
        )
        return samples, {
            "interpolate": str(content["interpolate"]),
            "interpolator": str(content["interpolator"]),
            "rate_hz": float(content["rate_hz"]),
        }
    except KeyError as error:
        raise InputError(f"the array {error} is missing") from error
    except (ValueError, TypeError) as error:
        raise InputError(f"its arrays do not fit together: {error}") from error
