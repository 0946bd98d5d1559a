"""The ``.npz`` file of a texture model; the layout is in ``docs/reference/model-file.md``."""

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.models import find_model
from mmt.texture.field.trend import NO_TREND, Trend
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.model.fitted import Fitted
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel

FORMAT_VERSION: Final = 5
"""Of what is written where level or shape are estimates of their own. Version 4, whose level has
hyperparameters of another prior, is read too, version 2, without what was fitted, and version 1,
whose models are isotropic and by Delaunay."""

INTERPOLATED_VERSION: Final = 3
"""Of what is written where both are interpolated, as earlier programs render it."""

_NETWORK: Final = ("network_kernel", "network_degree", "network_epsilon", "network_smoothing")
"""Arrays of the networks' settings, in their order in `RadialBasisSettings`."""

_Arrays = dict[str, Any]


def load_model(source: str | Path) -> "TextureModel":
    """Load a texture model: a shipped one by its name, or a ``.npz`` file.

    Raises
    ------
    InputError
        It is neither, or the file is not a texture model; the message lists the shipped names.

    Examples
    --------
    >>> import mmt
    >>> import numpy as np
    >>> model = mmt.load_model("oak")
    >>> vibration_m_s2 = mmt.Synthesizer(model, seed=1).render(np.full(500, 100.0), np.ones(500))
    >>> vibration_m_s2.shape
    (500,)
    """
    from mmt.texture.model.texture_model import TextureModel

    return TextureModel.load(find_model(Path(source)))


def pack(model: "TextureModel") -> bytes:
    """Return a model as the content of a file."""
    samples, space = model.samples, model.space
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        format_version=np.int64(_written_version(model)),
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
        **_level_arrays(model),
        **_fitted_arrays(model.fitted, directed=space.directed),
    )
    return buffer.getvalue()


def unpack(data: bytes) -> tuple[TextureSamples, dict[str, Any]]:
    """Return the samples and the settings of a model from what `pack` returned.

    Raises
    ------
    InputError
        It is no model, has another version, lacks an array, or one is out of its range.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            content = {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError("not a texture model (.npz), or cut off") from error
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
        return samples, {
            "interpolate": str(content["interpolate"]),
            "interpolator": str(content["interpolator"]),
            "rate_hz": float(content["rate_hz"]),
            **_estimates(content, version),
            "fitted": _fitted(content, version, directed=space.directed) if version > 2 else None,
        }
    except KeyError as error:
        raise InputError(f"the array {error} is missing") from error
    except (ValueError, TypeError) as error:
        raise InputError(f"its arrays do not fit together: {error}") from error


def _version(content: _Arrays) -> int:
    """Return the version of a file, whose arrays are completed where it is the first."""
    version = int(content.get("format_version", 0))
    if not 1 <= version <= FORMAT_VERSION:
        raise InputError(f"format version is {version}, this program reads 1 to {FORMAT_VERSION}")
    if version == 1:
        content.update(inputs=np.array("isotropic"), interpolator=np.array("delaunay"))
    return version


def _estimates(content: _Arrays, version: int) -> _Arrays:
    if version <= INTERPOLATED_VERSION:
        return {}
    return {"level": str(content["level"]), "shape": str(content["shape"])}


def _numbers(content: _Arrays, name: str) -> FloatArray | None:
    return np.asarray(content[name], dtype=np.float64) if name in content else None


def _written_version(model: "TextureModel") -> int:
    plain = model.level == "interpolated" and model.shape == "measured"
    return INTERPOLATED_VERSION if plain else FORMAT_VERSION


def _level_arrays(model: "TextureModel") -> _Arrays:
    arrays: _Arrays = {}
    if model.samples.effective is not None:
        arrays["effective_samples"] = model.samples.effective
    if model.samples.counts is not None:
        arrays["segment_samples"] = model.samples.counts
    if model.samples.noise_power > 0.0:
        arrays["noise_power"] = np.array(model.samples.noise_power)
    if _written_version(model) == FORMAT_VERSION:
        arrays.update(level=np.array(model.level), shape=np.array(model.shape))
    return arrays


def _fitted_arrays(fitted: Fitted, *, directed: bool) -> _Arrays:
    arrays: _Arrays = {}
    if directed:
        arrays["trend_exponents"] = np.array(fitted.trend)
    if fitted.networks:
        rows = [(n.kernel, n.highest_degree, n.epsilon, n.smoothing) for n in fitted.networks]
        columns = map(np.array, zip(*rows, strict=True))
        arrays.update(zip(_NETWORK, columns, strict=True))
    if fitted.level is not None:
        arrays["level_hyperparameters"] = fitted.level
    return arrays


def _fitted(content: _Arrays, version: int, *, directed: bool) -> Fitted:
    trend, networks = NO_TREND, []
    if directed:
        trend = Trend(*content["trend_exponents"].astype(np.float64).tolist())
        trend.check()
    if str(content["interpolator"]) == "rbf":
        columns = [content[name] for name in _NETWORK]
        if any(column.shape != (2,) for column in columns) or columns[1].dtype.kind != "i":
            raise InputError("its networks are not two, or their degrees no integers")
        rows = zip(*(column.tolist() for column in columns), strict=True)
        networks = [RadialBasisSettings(*row) for row in rows]
    level = _numbers(content, "level_hyperparameters") if version >= FORMAT_VERSION else None
    return Fitted(trend, tuple(networks), level)
