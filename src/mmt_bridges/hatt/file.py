"""Read and write the XML files of the Penn Haptic Texture Toolkit (HaTT).

A file is a ``modelSet``: filters at points of speed and force, which are the vertices of a
triangulation, and its triangles. At 10 kHz the filters have only poles, at 1 kHz poles and zeros.
The toolkit's files may not be passed on, so none comes with this package.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.bounds import finite_number
from mmt.core.errors import InputError, naming, short_message
from mmt.core.files.untrusted import parse_xml

_LARGEST_BYTES: Final = 1 << 26
_ACCELERATION: Final = {"m/s^2": 1.0, "m/s2": 1.0, "m/s/s": 1.0, "mm/s^2": 1e-3, "g": 9.80665}
_SPEED: Final = {"mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
_FORCE: Final = {"n": 1.0, "mn": 1e-3}


@dataclass(frozen=True, eq=False)
class HattModelSet:
    """Content of a file, in mm/s, N and m/s2.

    Attributes
    ----------
    material
        Name of the texture.
    rate_hz
        Sampling rate of the filters.
    friction
        Coefficient of kinetic friction, or None if the file has none.
    maximum_speed_mm_s, maximum_force_n
        Limits of the plane of speed and force.
    speed_mm_s, force_n
        Speed and force of each vertex, shape (n,).
    lsf
        Line spectral frequencies of its poles in radians, shape (n, p).
    zeros
        Coefficients c[0] ... c[q] of the numerator, its gain included, shape (n, q + 1);
        (n, 1) if there are only poles.
    variance
        Variance of the excitation in (m/s2)^2, shape (n,).
    triangles
        Corners, counted from 0, shape (t, 3).
    """

    material: str
    rate_hz: float
    friction: float | None
    maximum_speed_mm_s: float
    maximum_force_n: float
    speed_mm_s: FloatArray
    force_n: FloatArray
    lsf: FloatArray
    zeros: FloatArray
    variance: FloatArray
    triangles: IntArray


def read_hatt(path: Path) -> HattModelSet:
    """Read a file.

    Raises
    ------
    InputError
        The file cannot be read, is not of HaTT, or holds bad numbers; the message says which.
    """
    with naming(f"model {path}"):
        with path.open("rb") as file:
            content = file.read(_LARGEST_BYTES + 1)
        if len(content) > _LARGEST_BYTES:
            raise InputError("over 64 MiB, so it is no file of that toolkit")
        return parse_hatt(content)


def parse_hatt(content: bytes) -> HattModelSet:
    """Read a file's content; raises `InputError` as `read_hatt` does."""
    root = parse_xml(content)
    if root.tag != "modelSet":
        raise InputError(f"its root is <{root.tag}>, not <modelSet>: this is no file of HaTT")
    acceleration = _unit(root, "AccelUnits", _ACCELERATION)
    speed, force = _unit(root, "SpeedUnits", _SPEED), _unit(root, "ForceUnits", _FORCE)
    models = root.findall("model")
    if not models:
        raise InputError("it holds no <model>")
    _compare(root, "numMod", len(models))
    triangles = root.findall("tri")
    _compare(root, "numTri", len(triangles))
    lsf = _rows(models, "ARlsf/value")
    if lsf.shape[1] == 0:
        raise InputError("model 1 has no <ARlsf>: only files with line spectral frequencies count")
    return HattModelSet(
        material=(root.findtext("material") or "").strip(),
        rate_hz=_positive(root, "SampleRate"),
        friction=None if root.find("mu") is None else _number(root, "mu", "the file"),
        maximum_speed_mm_s=_positive(root, "maxSpeed") * speed,
        maximum_force_n=_positive(root, "maxForce") * force,
        speed_mm_s=_column(models, "speedMod") * speed,
        force_n=_column(models, "forceMod") * force,
        lsf=lsf,
        zeros=_zeros(models),
        variance=_column(models, "var") * acceleration**2,
        triangles=_triangles(triangles, len(models)),
    )


def _zeros(models: list[ET.Element]) -> FloatArray:
    """Return the numerators (n, q + 1), multiplied by their gains."""
    coefficients = _rows(models, "MAcoeff/value")
    if coefficients.shape[1] == 0:
        coefficients = np.ones((len(models), 1))
    elif coefficients.shape[1] > 1 and not (coefficients[:, 0] == 1.0).all():
        raise InputError("an <MAcoeff> does not begin with 1: this form is not known")
    gain = np.array(
        [
            1.0 if model.find("gain") is None else _number(model, "gain", f"model {number}")
            for number, model in enumerate(models, start=1)
        ]
    )
    numerators: FloatArray = coefficients * gain[:, np.newaxis]
    return numerators


def _triangles(elements: list[ET.Element], count: int) -> IntArray:
    rows = _rows(elements, "value", what="triangle")
    if rows.shape[1] not in (0, 3):
        raise InputError(f"a <tri> has {rows.shape[1]} corners, not 3")
    corners = rows.reshape(-1, 3).astype(np.int64)
    if corners.size and not ((corners >= 1) & (corners <= count)).all():
        raise InputError(f"a <tri> names a model that is not there: allowed is 1 to {count}")
    return corners - 1


def _rows(elements: list[ET.Element], path: str, *, what: str = "model") -> FloatArray:
    """Return the numbers below each element, shape (n, k), k equal for all."""
    rows = [
        [_parse(value.text, path, f"{what} {number}") for value in element.findall(path)]
        for number, element in enumerate(elements, start=1)
    ]
    for number, row in enumerate(rows, start=1):
        if len(row) != len(rows[0]):
            raise InputError(
                f"{what} {number} has {len(row)} numbers in <{path.partition('/')[0]}>, "
                f"{what} 1 has {len(rows[0])}"
            )
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else 0)


def _column(models: list[ET.Element], tag: str) -> FloatArray:
    values = [_number(model, tag, f"model {n}") for n, model in enumerate(models, start=1)]
    if min(values) < 0.0:
        raise InputError(f"model {int(np.argmin(values)) + 1}: <{tag}> is negative")
    return np.array(values)


def _number(element: ET.Element, tag: str, where: str) -> float:
    text = element.findtext(tag)
    if text is None:
        raise InputError(f"{where} has no <{tag}>")
    return _parse(text, tag, where)


def _parse(text: str | None, tag: str, where: str) -> float:
    try:
        return finite_number(text or "")
    except ValueError:
        raise InputError(
            f"{where}: <{tag}> is {short_message(text)!r}, a finite number is needed"
        ) from None


def _positive(root: ET.Element, tag: str) -> float:
    value = _number(root, tag, "the file")
    if value <= 0.0:
        raise InputError(f"<{tag}> is {value:g}: it must be positive")
    return value


def _compare(root: ET.Element, tag: str, count: int) -> None:
    if root.find(tag) is not None and _number(root, tag, "the file") != count:
        raise InputError(
            f"<{tag}> is {short_message(root.findtext(tag))}, but {count} are there: cut off?"
        )


def _unit(root: ET.Element, tag: str, known: dict[str, float]) -> float:
    """Return the factor that converts a value from the file's unit."""
    text = root.findtext(tag)
    if text is None:
        return 1.0
    name = text.strip().lower().replace("sec", "s")
    if name not in known:
        raise InputError(f"<{tag}> is {short_message(text)!r}, known are {', '.join(known)}")
    return known[name]


def format_hatt(content: HattModelSet) -> bytes:
    """Return the XML file of filters that have only poles.

    Raises
    ------
    InputError
        The filters have zeros.
    """
    if content.zeros.shape[1] > 1:
        raise InputError("filters with zeros are read, not written")
    from mmt.texture.autoregression.forms import lsf_to_ar

    root = ET.Element("modelSet")
    add = partial(_add, root)
    add("material", content.material)
    add("AccelUnits", "m/s^2")
    add("SpeedUnits", "mm/s")
    add("ForceUnits", "N")
    add("SampleRate", f"{content.rate_hz:.10g}")
    if content.friction is not None:
        add("mu", f"{content.friction:.10g}")
    add("numMod", str(len(content.lsf)))
    add("numTri", str(len(content.triangles)))
    add("maxSpeed", f"{content.maximum_speed_mm_s:.10g}")
    add("maxForce", f"{content.maximum_force_n:.10g}")
    add("numARCoeff", str(content.lsf.shape[1] + 1))
    add("numMACoeff", "0")
    _add_values(add("speedList", ""), np.unique(content.speed_mm_s))
    _add_values(add("forceList", ""), np.unique(content.force_n))
    for corners in content.triangles:
        triangle = add("tri", "")
        for corner in corners:
            ET.SubElement(triangle, "value").text = str(int(corner) + 1)
    for number, ar in enumerate(lsf_to_ar(content.lsf)):
        model = add("model", "")
        add_to = partial(_add, model)
        _add_values(add_to("ARcoeff", ""), np.append(1.0, ar))
        _add_values(add_to("ARlsf", ""), content.lsf[number])
        add_to("var", _text(content.variance[number] * content.zeros[number, 0] ** 2))
        add_to("gain", "1")
        add_to("speedMod", _text(content.speed_mm_s[number]))
        add_to("forceMod", _text(content.force_n[number]))
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root) + b"\n"


def _add(parent: ET.Element, tag: str, text: str) -> ET.Element:
    element = ET.SubElement(parent, tag)
    element.text = text or None
    return element


def _add_values(parent: ET.Element, values: FloatArray) -> None:
    for value in values:
        ET.SubElement(parent, "value").text = _text(value)


def _text(value: float) -> str:
    return repr(float(value))
