"""Cause of a model's error at the point where it is farthest from the known texture."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.model_errors import Strokes
from mmt.evaluation.results import Limit, Worst
from mmt.texture.interpolation.vertices import COINCIDENT
from mmt.texture.model.texture_model import TextureModel

_SPARSE: Final = 0.2  # of the normalised plane
_MUCH: Final = 0.5


class StrokeError(NamedTuple):
    """Level (dB) and shape of one stroke against the truth."""

    power_error_db: float
    gfc: float

    def explains(self, other: "StrokeError", *, shape: bool) -> bool:
        """Return whether this error is at least half of another one, and of the same sign."""
        if shape:
            return 1.0 - self.gfc >= _MUCH * (1.0 - other.gfc)
        if other.power_error_db == 0.0:
            return True
        return self.power_error_db / other.power_error_db >= _MUCH

    def text(self, *, shape: bool) -> str:
        """Return the level or the shape as text."""
        return f"GFC {self.gfc:.3f}" if shape else f"{self.power_error_db:+.1f} dB"


def explain(
    model: TextureModel,
    stroke: Strokes,
    error: StrokeError,
    own: Callable[[Strokes], StrokeError],
    without_heading: StrokeError | None,
    *,
    shape: bool,
) -> Worst:
    """Explain what limits a model at one stroke.

    Parameters
    ----------
    model
        The model.
    stroke
        The stroke, shape (1,).
    error
        Error of the model at this stroke.
    own
        Returns the model's error at another stroke.
    without_heading
        Error of the texture's mean over all headings at this stroke; None if the texture does
        not depend on the heading.
    shape
        Whether the shape is in question, else the level.
    """
    speed_mm_s, force_n, heading_rad = (float(values[0]) for values in stroke)
    point = model.space.normalise(stroke.inputs(model.space))[0]
    distances = np.linalg.norm(model.points - point, axis=1)
    nearest = int(distances.argmin())
    boundary = _boundary_share(model, point)
    unaware = None if model.space.directed else without_heading
    if unaware is not None and unaware.explains(error, shape=shape):
        limit: Limit = "heading"
        reason = (
            f"the {'shape' if shape else 'level'} depends on the heading, which the model does not "
            f"know: the mean over all headings itself has {unaware.text(shape=shape)} here"
        )
    else:
        sample, apart = _stroke_of(model, nearest, stroke), float(distances[nearest])
        limit, reason = _cause(model, stroke, error, own, sample, apart, boundary, shape=shape)
    return Worst(
        measure="gfc" if shape else "power",
        speed_mm_s=speed_mm_s,
        force_n=force_n,
        heading_deg=None if without_heading is None else float(np.degrees(heading_rad)),
        power_error_db=error.power_error_db,
        gfc=error.gfc,
        nearest_sample=float(distances[nearest]),
        boundary_share=boundary,
        limit=limit,
        reason=reason,
    )


def _cause(
    model: TextureModel,
    stroke: Strokes,
    error: StrokeError,
    own: Callable[[Strokes], StrokeError],
    sample: Strokes,
    apart: float,
    boundary: float,
    *,
    shape: bool,
) -> tuple[Limit, str]:
    """Return what limits a model, the heading aside; the nearest sample is `apart` from there."""
    directed, what = model.space.directed, "shape" if shape else "level"
    place = f"the nearest sample ({_text(sample, directed=directed)})"
    far = f"{apart:.2f} of the {'space' if directed else 'plane'} away"
    if not shape and model.method == "field" and model.level_field is not None:
        deviation_db = float(model.level_db(*stroke.inputs(model.space).T)[1][0])
        return "field", (
            f"the level follows from all strokes, and is expected to be right to "
            f"{deviation_db:.1f} dB here (standard deviation); {place} is {far}"
        )
    if boundary >= _MUCH:
        beyond = f"boundary points weigh {boundary:.0%} here"
        if model.interpolant.is_network:
            beyond = "the network goes beyond its samples here"
        return "beyond the samples", f"{beyond}; {place} is {far}"
    there = own(sample)
    value = there.text(shape=shape)
    if there.explains(error, shape=shape):
        return "fit", f"the model's {what} at {place} itself has {value}"
    if apart > _SPARSE:
        return "sparse", f"{place} is {far}, and the {what} changes in between"
    return "interpolation", f"the {what} changes between samples; {place}, {far}, has {value}"


def _stroke_of(model: TextureModel, sample: int, stroke: Strokes) -> Strokes:
    """Return the stroke of a sample, with the heading of `stroke` if the model knows none."""
    velocity_x, velocity_y = model.samples.inputs[sample, :2]
    heading = np.arctan2(velocity_y, velocity_x) if model.space.directed else stroke.heading_rad[0]
    speed_mm_s, force_n = model.samples.speed_mm_s[sample], model.samples.force_n[sample]
    return Strokes(*(np.array([value]) for value in (speed_mm_s, force_n, heading)))


def _text(stroke: Strokes, *, directed: bool) -> str:
    speed_mm_s, force_n, heading_rad = (float(values[0]) for values in stroke)
    towards = f" to {np.degrees(heading_rad) % 360.0:.0f} degrees" if directed else ""
    return f"{speed_mm_s:.0f} mm/s{towards}, {force_n:.2f} N"


def _boundary_share(model: TextureModel, point: FloatArray) -> float:
    """Return the weight of vertices at which there is no sample."""
    corners, weights = model.triangulation.weights(point[None, :])
    dimensions = model.space.dimensions
    places = model.vertices[corners[0], :dimensions]
    offsets = model.points[None, :, :] - places[:, None, :]
    boundary = np.linalg.norm(offsets, axis=2).min(axis=1) > COINCIDENT
    return float(weights[0][boundary].sum())
