"""A model as JSON, for other renderers; the form is in ``docs/reference/model-json.md``.

It holds computed arrays: vertices and their simplices, or the network of paper B, and the table of
the level. A renderer needs no fitting, no triangulation and no solver.
"""

import base64
import json
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.errors import InputError
from mmt.texture.interpolation.interpolant import TABLE, TABLE_SIZES
from mmt.texture.model.texture_model import TextureModel

FORMAT: Final = "mmt-texture"
VERSION: Final = 1
MOST_ROWS: Final = 5_000
"""Largest number of vertices, or of samples of a network."""
MOST_SIMPLICES: Final = 10_000
_LONGEST_NAME: Final = 200


def model_json(model: TextureModel, name: str) -> str:
    """Return the JSON form of a model.

    Parameters
    ----------
    model
        Any model; of a growing one, its present state.
    name
        Name of the model; cut after 200 characters.

    Raises
    ------
    InputError
        The model has more samples than a page renders in time.
    """
    rows, links, tail = model.interpolant
    if len(rows) > MOST_ROWS or len(links) > MOST_SIMPLICES:
        raise InputError(
            f"model {name}: {len(rows)} vertices in {len(links)} simplices; a page renders "
            f"{MOST_ROWS} in {MOST_SIMPLICES} at most: select fewer samples"
        )
    form: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "name": name[:_LONGEST_NAME],
        "method": model.method,
        "inputs": model.space.name,
        "rate_hz": model.rate_hz,
        "maximum_speed_mm_s": model.space.maximum_speed_mm_s,
        "maximum_force_n": model.space.maximum_force_n,
        "order": model.order,
        "samples": len(model.samples),
        "rows": _encoded(rows, "<f8"),
    }
    if model.interpolant.is_network:
        form["network"] = _encoded(tail, "<f8")
    else:
        form["simplices"] = _encoded(links[:, : model.dimensions + 1], "<u2")
    parameters = model.kernel_parameters
    shape = parameters[TABLE_SIZES:TABLE].astype(int)
    if shape.all():
        form["level"] = _encoded(parameters[TABLE:].reshape(shape), "<f8")
    return json.dumps(form, allow_nan=False, separators=(",", ":"))


_TYPES: Final = {"<f8": "float64", "<u2": "uint16"}


def _encoded(array: npt.NDArray[Any], code: str) -> dict[str, Any]:
    """Return an array as type, shape and base64 of its numbers, row by row, little-endian."""
    data = base64.b64encode(np.ascontiguousarray(array, dtype=code).tobytes()).decode()
    return {"type": _TYPES[code], "shape": list(array.shape), "data": data}
