"""Settings of texture modelling: plain values, with nothing compiled and no validation library.

A key of a scene's ``[texture]`` is one field here, with its default, its bounds (as
`annotated_types`, which the scene's validation reads) and its meaning, and one line in
``docs/reference/scene.md``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, NamedTuple

from annotated_types import Ge, Gt, Le, Lt

from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.interpolation.registry import check_name

Method = Literal["custom", "published"]
Axis = Literal["x", "y", "z"]
VibrationAxis = Literal["x", "y", "z", "dft321"]
Interpolated = Literal["variance", "power", "amplitude"]
Inputs = Literal["isotropic", "anisotropic"]
Level = Literal["interpolated", "gaussian_process"]
Shape = Literal["measured", "smoothed"]
Criterion = Literal["distance", "uncertainty"]

CHANNELS: Final[dict[Inputs, tuple[str, ...]]] = {
    "isotropic": ("speed_mm_s", "force_n"),
    "anisotropic": ("velocity_x_mm_s", "velocity_y_mm_s", "force_n"),
}
"""The inputs of each space, in their order, with their units. Velocity x and y are along the
two axes other than the surface's normal, in the order of the axes."""

MAXIMUM_SPEED_MM_S = 300.0
"""Paper A, section V.B: the plane ends here; faster strokes count as this fast."""

MAXIMUM_FORCE_N = 3.0
"""Paper A, section V.B: the plane ends here; stronger forces count as this strong."""


class Distances(NamedTuple):
    """Completion distances at which rendering starts and modelling ends."""

    start: float
    stop: float


DISTANCES: Final[dict[Inputs, Distances]] = {
    "isotropic": Distances(7.5, 4.243),
    "anisotropic": Distances(52.63, 36.0),
}
"""Defaults for each kind of inputs; how they are derived is in
`mmt.texture.completion.distance`."""

INTERPOLATED: Final[Mapping[str, Any]] = MappingProxyType(
    {"level": "interpolated", "shape": "measured", "criterion": "distance"}
)
"""The keys of a model that is interpolated between its samples as they are, and does not know its
error."""

_AS_PUBLISHED: Final = {"interpolate": "variance", **INTERPOLATED}

PUBLISHED: Final[Mapping[Inputs, Mapping[str, Any]]] = MappingProxyType(
    {
        "isotropic": {**_AS_PUBLISHED, "interpolator": "delaunay"},
        "anisotropic": {**_AS_PUBLISHED, "interpolator": "network"},
    }
)
"""The keys that the method ``"published"`` sets: of paper A over speed and force, of paper B
(Abdulali and Jeon, Data-driven rendering of anisotropic haptic textures) over velocity and
force."""

Distance = Annotated[float, Gt(0)] | Literal["auto"]
"""A completion distance, or that of `DISTANCES` for the inputs."""

START_SHARE: Final = 0.75
"""Expected share at which rendering starts: about that which the published method leaves right at
its stop criterion (0.77, the mean of 17 HaTT models)."""

STOP_SHARE: Final = 0.9
"""Expected share at which modelling ends: what a person is to find right, nine strokes of ten. How
often it is so where this is expected is in the page on certainty."""


@dataclass(frozen=True)
class CriterionScale:
    """How to read the value of a criterion.

    ``criterion`` is its name, ``title`` what it measures, ``start`` and ``stop`` its thresholds;
    ``rises`` says whether larger values are better.
    """

    criterion: Criterion
    title: str
    start: float
    stop: float
    rises: bool

    def meets(self, value: float, threshold: float) -> bool:
        """Say whether a value is as good as a threshold, or better."""
        return value >= threshold if self.rises else value <= threshold


def distance_scale(start: float, stop: float) -> CriterionScale:
    """Return the scale of the published sum of distances."""
    return CriterionScale("distance", "completion sum", start, stop, rises=False)


@dataclass(frozen=True)
class OnlineSelectionSettings:
    """``[texture.selection]``: keep outliers out of a growing model, and its size below a limit.

    See `mmt.texture.selection.online`.
    """

    false_alarms: Annotated[float, Ge(0.001), Le(0.2)] = 0.01
    """Share of the good samples that may be taken for outliers."""

    largest: Annotated[int, Ge(10), Le(1000)] = 200
    """Number of samples above which redundant ones are left out of the model."""


@dataclass(frozen=True)
class SurfaceSettings:
    """``[texture.surfaces]``: a model for each of several surfaces; see `mmt.texture.surfaces`."""

    false_alarms_per_hour: Annotated[float, Ge(0.001), Le(1000)] = 1.0
    """Expected false alarms of the change-point detection in an hour of stroking."""

    most: Annotated[int, Ge(2), Le(100)] = 20
    """Largest number of surfaces; the one left longest ago is dropped for a new one."""


@dataclass(frozen=True)
class TextureSettings:
    """The keys of ``[texture]`` that concern the numerics.

    Raises
    ------
    ValueError
        A combination of values is not allowed. Bounds of single values are checked where a scene
        is read.
    """

    method: Method = "custom"
    """How a texture is modelled: by the keys below, or as published."""

    axis: VibrationAxis = "z"
    """The acceleration that is modelled: one axis, or all three joined by DFT321."""

    normal: Axis = "z"
    """The surface's normal axis; speed is taken in the plane across it, force along it."""

    order: int | Literal["auto"] = "auto"
    """Order of all autoregressive filters, 1 to 64, or chosen from the data."""

    overlap_samples: Annotated[int, Ge(0), Le(2000)] = 200
    """Newest samples into which a segment must not reach to be final."""

    straightness_mm: Annotated[float, Gt(0), Le(50)] = 1.0
    """Largest distance of the path from its chord inside a segment (tau_1)."""

    stationarity: Annotated[float, Gt(0), Le(1)] = 0.12
    """Largest coefficient of variation of speed and force inside a segment (tau_2)."""

    shortest_samples: Annotated[int, Ge(30), Le(2000)] = 120
    """Shortest segment."""

    longest_samples: Annotated[int, Ge(100), Le(5000)] = 1000
    """Longest segment; at least twice the shortest."""

    least_speed_mm_s: Annotated[float, Gt(0), Le(300)] = 10.0
    """Slower motion is not modelled."""

    least_force_n: Annotated[float, Gt(0), Le(3)] = 0.1
    """Lighter contact is not modelled."""

    inputs: Inputs = "isotropic"
    """What the texture is a function of: speed and force, or velocity vector and force."""

    start_distance: Distance = "auto"
    """Completion sum at which rendering starts, for the criterion ``"distance"``."""

    stop_distance: Distance = "auto"
    """Completion sum at which modelling ends; not above `start_distance`."""

    criterion: Criterion = "uncertainty"
    """What decides when rendering starts and modelling ends."""

    start_share: Annotated[float, Gt(0), Lt(1)] = START_SHARE
    """Expected share at which rendering starts, for the criterion ``"uncertainty"``."""

    stop_share: Annotated[float, Gt(0), Lt(1)] = STOP_SHARE
    """Expected share at which modelling ends; not below `start_share`."""

    interpolate: Interpolated = "power"
    """What is linear between samples, beside the line spectral frequencies."""

    interpolator: str = "delaunay"
    """A name known to `mmt.texture.interpolation.registry`."""

    level: Level = "gaussian_process"
    """What the vibration's power follows."""

    shape: Shape = "smoothed"
    """The spectra at the samples."""

    selection: OnlineSelectionSettings | None = None
    """Selection of samples; None keeps them all."""

    surfaces: SurfaceSettings | None = None
    """A model for each of several surfaces; None for a single model."""

    def __post_init__(self) -> None:
        if self.method == "published":
            self._set_published()
        if self.order != "auto" and not 1 <= self.order <= LARGEST_ORDER:
            raise ValueError(f"order is {self.order}, allowed are 'auto' and 1 to {LARGEST_ORDER}")
        start, stop = self.distances
        if stop > start:
            raise ValueError(
                f"stop_distance is {stop:g} and start_distance "
                f"{start:g}: stop_distance must not exceed start_distance"
            )
        if self.stop_share < self.start_share:
            raise ValueError(
                f"stop_share is {self.stop_share:g} and start_share {self.start_share:g}: "
                "stop_share must not be below start_share"
            )
        if self.criterion == "uncertainty" and self.level != "gaussian_process":
            raise ValueError(
                f'criterion is "uncertainty" and level "{self.level}", whose error is not known: '
                'leave level at "gaussian_process", or set criterion to "distance"'
            )
        if self.level != "interpolated" and self.interpolate != "power":
            raise ValueError(
                f'interpolate is "{self.interpolate}" and level "{self.level}": with this level '
                'nothing is interpolated beside the spectrum\'s shape; leave interpolate at "power"'
            )
        if self.longest_samples < 2 * self.shortest_samples:
            raise ValueError("longest_samples must be at least twice shortest_samples")
        check_name(self.interpolator)

    def _set_published(self) -> None:
        """Set the keys that the published method has, where nothing else was set."""
        if self.selection is not None:
            raise ValueError(
                'method is "published" and there is a table selection: what is published selects '
                "from whole trials, by `mmt model select --method published`; leave the table out"
            )
        usual = {field.name: field.default for field in fields(self)}
        for key, value in PUBLISHED[self.inputs].items():
            allowed = {usual[key], *(of[key] for of in PUBLISHED.values())}
            if getattr(self, key) not in allowed:
                raise ValueError(
                    f'method is "published" and {key} "{getattr(self, key)}": as published it is '
                    f'"{value}"; leave {key} out, or set method to "custom"'
                )
            object.__setattr__(self, key, value)

    @property
    def distances(self) -> Distances:
        """The completion distances, those of the inputs in place of ``"auto"``."""
        usual = DISTANCES[self.inputs]
        return Distances(
            usual.start if self.start_distance == "auto" else self.start_distance,
            usual.stop if self.stop_distance == "auto" else self.stop_distance,
        )

    @property
    def scale(self) -> CriterionScale:
        """What the criterion measures, and its thresholds."""
        if self.criterion == "distance":
            return distance_scale(*self.distances)
        title = "expected share"
        return CriterionScale(self.criterion, title, self.start_share, self.stop_share, rises=True)


@dataclass(frozen=True)
class ModellingSettings(TextureSettings):
    """Settings of the online modelling: the keys of ``[texture]``, and the stream's rate."""

    rate_hz: float = 1000.0
    """Sampling rate of the stream."""
