"""Map the orientation of a recording: find the components of a quaternion by their names."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.quaternions import LARGEST_OFF
from mmt.session.importing.options import ImportOptions

_ROUNDED: Final = 1e-6
"""Deviation of a norm from 1 that is left as it is: that of rounding to single precision."""


def components_mapped(
    options: ImportOptions, values: Mapping[str, FloatArray], origin: str
) -> ImportOptions:
    """Return the options with four components mapped in place of an orientation as a whole.

    That is an array (n, 4) whose name tells its order, or a message with the members w to z.
    `orientation`, as mmt exports it, has w first.

    Raises
    ------
    InputError
        It is neither; `origin` is the name of the file.
    """
    columns = dict(options.columns)
    text = columns.pop("orientation", None)
    name = text or "orientation"
    within = [n[:-2] for n in values if n.startswith(f"{name}.") and n.endswith(".w")]
    if name in values and values[name].shape[1:] == (4,):
        told = "wxyz" if name == "orientation" else name.lower()
        order = next((order for order in ("wxyz", "xyzw") if order in told), None)
        if order is None:
            raise InputError(
                f"{origin}: orientation is mapped to {name}, whose name does not tell its order, "
                "as q_wxyz or q_xyzw would: map its four components, as in --map "
                f"orientation_w={name}[0]"
            )
        parts = {f"orientation_{axis}": f"{name}[{order.index(axis)}]" for axis in "wxyz"}
    elif text is not None and len(within) == 1:
        parts = {f"orientation_{axis}": f"{within[0]}.{axis}" for axis in "wxyz"}
    elif text is not None:
        raise InputError(
            f"{origin}: orientation is mapped to {name}, which is no array of shape (n, 4), and no "
            "message with w, x, y and z"
        )
    else:
        return options
    return replace(options, columns={**parts, **columns})


def normalised(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (n, 4), those that are nearly of norm 1 with that norm."""
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    off = np.abs(norms - 1.0)
    return quaternions / np.where((off > _ROUNDED) & (off <= LARGEST_OFF), norms, 1.0)
