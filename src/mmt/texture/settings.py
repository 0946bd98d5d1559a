"""What the modelling of a texture can be told; plain values, nothing compiled."""

from dataclasses import dataclass
from typing import Final, Literal

Axis = Literal["x", "y", "z"]
VibrationAxis = Literal["x", "y", "z", "dft321"]
Interpolated = Literal["variance", "power", "amplitude"]
Inputs = Literal["isotropic", "anisotropic"]
Interpolation = Literal["delaunay", "nearest", "rbf"]
Level = Literal["interpolated", "gaussian_process"]
Shape = Literal["measured", "smoothed"]
Criterion = Literal["distance", "uncertainty"]

MAXIMUM_SPEED_MM_S = 300.0
"""Paper A, section V.B: the plane ends here; faster strokes count as this fast."""

MAXIMUM_FORCE_N = 3.0
"""Paper A, section V.B: the plane ends here; stronger forces count as this strong."""

LARGEST_ORDER = 64
"""The highest autoregressive order that a model may have."""


DISTANCES: Final[dict[Inputs, tuple[float, float]]] = {
    "isotropic": (7.5, 4.243),
    "anisotropic": (52.63, 36.0),
}
"""Completion distances at which rendering starts and modelling ends; how they are derived is in
`mmt.texture.completion.distance`."""

AUTOMATIC: Final = 0.0
"""Stands for the distance that belongs to the inputs."""


START_SHARE: Final = 0.75
"""Expected share at which rendering starts: about that which the published method leaves right at
its stop criterion (0.78, the mean of 170 sessions on 17 known textures)."""

STOP_SHARE: Final = 0.95
"""Expected share at which modelling ends: nine of ten sessions that reach it are right on 0.9 of
the plane and more (`mmt evaluate --compare published,ours`)."""


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
    """Selection while a model grows; see `mmt.texture.selection.online`.

    ``limit``: score from which a sample is an outlier, None for the usual one. ``largest``:
    number of samples above which redundant ones are left out of the model.
    """

    limit: float | None = None
    largest: int = 200


@dataclass(frozen=True)
class SurfaceSettings:
    """Several surfaces in one session; see `mmt.texture.surfaces`.

    ``false_alarms_per_hour`` of stroking. ``most``: number of surfaces that are kept; beyond,
    the one on which the tool was not for longest leaves for a new one.
    """

    false_alarms_per_hour: float = 1.0
    most: int = 20


@dataclass(frozen=True)
class ModellingSettings:
    """Settings of the online modelling; the meaning of each is in the scene reference.

    ``axis`` (what becomes the vibration), ``normal`` (the surface's normal axis), ``order``
    ("auto" or 1 to 64), ``overlap_samples``, ``straightness_mm`` (tau_1), ``stationarity``
    (tau_2), ``shortest_samples``, ``longest_samples``, ``least_speed_mm_s``,
    ``least_force_n``, ``start_distance`` and ``stop_distance`` (`AUTOMATIC` for what belongs
    to the inputs), ``criterion``, ``start_share`` and ``stop_share`` (of the other criterion),
    ``interpolate``, ``inputs``, ``interpolator``, ``level``, ``shape``, ``selection`` (None for
    none), ``surfaces`` (None for one), ``rate_hz``.
    """

    axis: VibrationAxis = "z"
    normal: Axis = "z"
    order: int | Literal["auto"] = "auto"
    overlap_samples: int = 200
    straightness_mm: float = 1.0
    stationarity: float = 0.12
    shortest_samples: int = 120
    longest_samples: int = 1000
    least_speed_mm_s: float = 10.0
    least_force_n: float = 0.1
    start_distance: float = AUTOMATIC
    stop_distance: float = AUTOMATIC
    criterion: Criterion = "distance"
    start_share: float = START_SHARE
    stop_share: float = STOP_SHARE
    interpolate: Interpolated = "power"
    inputs: Inputs = "isotropic"
    interpolator: Interpolation = "delaunay"
    level: Level = "interpolated"
    shape: Shape = "measured"
    selection: OnlineSelectionSettings | None = None
    surfaces: SurfaceSettings | None = None
    rate_hz: float = 1000.0

    def __post_init__(self) -> None:
        start, stop = DISTANCES[self.inputs]
        for name, value in (("start_distance", start), ("stop_distance", stop)):
            if getattr(self, name) == AUTOMATIC:
                object.__setattr__(self, name, value)

    @property
    def scale(self) -> CriterionScale:
        """What the criterion measures, and its thresholds."""
        if self.criterion == "distance":
            return distance_scale(self.start_distance, self.stop_distance)
        title = "expected share"
        return CriterionScale(self.criterion, title, self.start_share, self.stop_share, rises=True)
