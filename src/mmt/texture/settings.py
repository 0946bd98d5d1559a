"""Settings of texture modelling: plain values, with nothing compiled and no validation library.

A key of a scene's ``[texture]`` is one field here, with its default, its bounds (see
`mmt.core.bounds`) and its meaning, and one line in ``docs/reference/scene.md``.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple

from annotated_types import Ge, Gt, Le, Lt

from mmt.core.bounds import RateHz, check_fields
from mmt.core.errors import SettingError
from mmt.core.frames import MOST_SAMPLES
from mmt.texture.autoregression.order_limit import LARGEST_ORDER, Order

Method = Literal["field", "published"]
Axis = Literal["x", "y", "z"]
VibrationAxis = Literal["x", "y", "z", "dft321"]
Inputs = Literal["isotropic", "anisotropic"]
Criterion = Literal["distance", "uncertainty"]

ORDER_AT_1_KHZ: Final = 16
"""Filters of rates up to 4 kHz remember as long, 16 ms; from there on 64 samples."""

LONGEST_BRIDGED: Final = 5
"""Missing frames in a row that are filled."""

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


class StartStop(NamedTuple):
    """Values of a criterion at which rendering starts and modelling ends."""

    start: float
    stop: float


DISTANCES: Final[dict[Inputs, StartStop]] = {
    "isotropic": StartStop(7.5, 4.243),
    "anisotropic": StartStop(52.63, 36.0),
}
"""Defaults for each kind of inputs; how they are derived is in
`mmt.texture.completion.distance`."""

THRESHOLDS: Final[dict[Method, tuple[str, str]]] = {
    "field": ("start_share", "stop_share"),
    "published": ("start_distance", "stop_distance"),
}
"""The keys of each method's own."""

Distance = Annotated[float, Gt(0)] | Literal["auto"]
"""A completion distance, or that of `DISTANCES` for the inputs."""

Share = Annotated[float, Gt(0), Lt(1)] | Literal["auto"]
"""An expected share, or `START_SHARE` or `STOP_SHARE`."""

JND_DB: Final = 20.0 * math.log10(1.17)
"""Just noticeable difference of vibration, 17 % in amplitude (Awan et al., section VII.A)."""

START_SHARE: Final = 0.65
"""Expected share at which rendering starts: two strokes of three, which is early enough for the
person who waits (decision 55 has what other values would give)."""

STOP_SHARE: Final = 0.86
"""Expected share at which modelling ends: what most textures come to within half a minute."""


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


def usual_order(rate_hz: float) -> int:
    """Return the order of filters at a sampling rate, if it is not chosen."""
    return min(LARGEST_ORDER, round(ORDER_AT_1_KHZ * max(1.0, rate_hz / 1e3)))


def surface_check_frames(rate_hz: float) -> int:
    """Return the frames between two checks of the stream for another surface, 50 ms."""
    return max(1, round(0.05 * rate_hz))


@dataclass(frozen=True)
class SurfaceSettings:
    """``[texture.surfaces]``: a model for each of several surfaces; see `mmt.texture.surfaces`."""

    false_alarms_per_hour: Annotated[float, Ge(0.001), Le(1000)] = 1.0
    """Expected false alarms of the change-point detection in an hour of stroking."""

    most: Annotated[int, Ge(2), Le(100)] = 20
    """Largest number of surfaces; the one left longest ago is dropped for a new one."""

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class TextureSettings:
    """The keys of ``[texture]`` that concern the numerics.

    Raises
    ------
    SettingError
        A value or a combination of values is not allowed.
    """

    method: Method = "field"
    """How a texture is modelled: by a field of its level with an expected share, or as published
    (Awan et al.; over velocity and force Abdulali and Jeon)."""

    axis: VibrationAxis = "z"
    """The acceleration that is modelled: one axis, or all three joined by DFT321."""

    normal: Axis = "z"
    """The surface's normal axis; speed is taken in the plane across it, force along it."""

    order: Order | Literal["auto"] = "auto"
    """Order of all autoregressive filters, 1 to 64, or `usual_order` of the rate."""

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

    longest_bridged_samples: Annotated[int, Ge(0), Le(10)] = LONGEST_BRIDGED
    """Missing frames in a row that are filled and not counted; more end a segment."""

    least_speed_mm_s: Annotated[float, Gt(0), Le(300)] = 10.0
    """Slower motion is not modelled."""

    least_force_n: Annotated[float, Gt(0), Le(3)] = 0.1
    """Lighter contact is not modelled."""

    inputs: Inputs = "isotropic"
    """What the texture is a function of: speed and force, or velocity vector and force."""

    start_distance: Distance = "auto"
    """Completion sum at which rendering starts, of the method ``"published"``."""

    stop_distance: Distance = "auto"
    """Completion sum at which modelling ends; not above `start_distance`."""

    start_share: Share = "auto"
    """Expected share at which rendering starts, of the method ``"field"``."""

    stop_share: Share = "auto"
    """Expected share at which modelling ends; not below `start_share`."""

    surfaces: SurfaceSettings | None = None
    """A model for each of several surfaces; None for a single model."""

    def __post_init__(self) -> None:
        check_fields(self)
        self._check_method()
        scale, (start, stop) = self.scale, THRESHOLDS[self.method]
        if not scale.meets(scale.stop, scale.start):
            raise SettingError(
                f"{stop} is {scale.stop:g} and {start} {scale.start:g}: {stop} must not "
                f"{'be below' if scale.rises else 'exceed'} {start}"
            )
        if self.longest_samples < 2 * self.shortest_samples:
            raise SettingError("longest_samples must be at least twice shortest_samples")

    def _check_method(self) -> None:
        for method, keys in THRESHOLDS.items():
            for key in keys if method != self.method else ():
                if getattr(self, key) != "auto":
                    own = " and ".join(THRESHOLDS[self.method])
                    raise SettingError(
                        f'{key} is of method "{method}", and method is "{self.method}": leave it '
                        f"out, or write {own}"
                    )

    @property
    def distances(self) -> StartStop:
        """The completion distances, those of the inputs in place of ``"auto"``."""
        usual = DISTANCES[self.inputs]
        return StartStop(
            usual.start if self.start_distance == "auto" else self.start_distance,
            usual.stop if self.stop_distance == "auto" else self.stop_distance,
        )

    @property
    def scale(self) -> CriterionScale:
        """What tells how complete a model is, and its thresholds."""
        if self.method == "published":
            return CriterionScale("distance", "completion sum", *self.distances, rises=False)
        start = START_SHARE if self.start_share == "auto" else self.start_share
        stop = STOP_SHARE if self.stop_share == "auto" else self.stop_share
        return CriterionScale("uncertainty", "expected share", start, stop, rises=True)


@dataclass(frozen=True)
class ModellingSettings(TextureSettings):
    """Settings of the online modelling: the keys of ``[texture]``, and the stream's rate."""

    rate_hz: RateHz = 1000.0
    """Rate of the stream's frames."""

    samples_per_frame: Annotated[int, Ge(1), Le(MOST_SAMPLES)] = 1
    """Samples of acceleration in a frame."""

    @property
    def vibration_rate_hz(self) -> float:
        """Sampling rate of acceleration and vibration, and of the model."""
        return self.rate_hz * self.samples_per_frame

    @property
    def filter_order(self) -> int:
        """The order of the filters, a number in place of ``"auto"``."""
        if self.order != "auto":
            return self.order
        return usual_order(self.vibration_rate_hz)
