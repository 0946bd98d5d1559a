"""Settings of texture modelling: plain values, with nothing compiled and no validation library.

Each key of a scene's ``[texture]`` is one field here, with default, bounds (see
`mmt.core.bounds`) and meaning. ``docs/reference/scene.md`` has one line for each key.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple, get_args

from annotated_types import Ge, Gt, Le, Lt

from mmt.core.bounds import RateHz, check_fields
from mmt.core.errors import SettingError
from mmt.core.frames import MOST_SAMPLES
from mmt.texture.autoregression import LARGEST_ORDER, Order

Method = Literal["field", "published"]
METHODS: Final = get_args(Method)
Axis = Literal["x", "y", "z"]
VibrationAxis = Literal["x", "y", "z", "dft321"]
Inputs = Literal["isotropic", "anisotropic"]
Criterion = Literal["distance", "uncertainty"]

ORDER_AT_1_KHZ: Final = 16
"""Order up to 1 kHz. It rises with the rate (a memory of 16 ms) to 64 at 4 kHz and above."""

LONGEST_BRIDGED: Final = 5
"""Largest number of missing frames in a row that are filled."""

CHANNELS: Final[dict[Inputs, tuple[str, ...]]] = {
    "isotropic": ("speed_mm_s", "force_n"),
    "anisotropic": ("velocity_x_mm_s", "velocity_y_mm_s", "force_n"),
}
"""The inputs of each space, in their order, with their units. Velocity x and y are along the
two axes other than the surface's normal, in the order of the axes."""

MAXIMUM_SPEED_MM_S = 300.0
"""Largest speed of the plane (paper A, section V.B); faster strokes count as this fast."""

MAXIMUM_FORCE_N = 3.0
"""Largest force of the plane (paper A, section V.B); stronger forces count as this strong."""


class StartStop(NamedTuple):
    """Values of a criterion at which rendering starts and modelling ends."""

    start: float
    stop: float


DISTANCES: Final[dict[Inputs, StartStop]] = {
    "isotropic": StartStop(7.5, 4.243),
    "anisotropic": StartStop(52.63, 36.0),
}
"""Default distances for each kind of inputs, derived in `mmt.texture.completion.distance`."""

THRESHOLDS: Final[dict[Method, tuple[str, str]]] = {
    "field": ("start_share", "stop_share"),
    "published": ("start_distance", "stop_distance"),
}
"""Keys of the start and stop thresholds of each method."""

Distance = Annotated[float, Gt(0)] | Literal["auto"]
"""A completion distance; ``"auto"`` takes the default of `DISTANCES` for the inputs."""

Share = Annotated[float, Gt(0), Lt(1)] | Literal["auto"]
"""An expected share; ``"auto"`` takes `START_SHARE` or `STOP_SHARE`."""

JND_DB: Final = 20.0 * math.log10(1.17)
"""Just noticeable difference of vibration, 17 % in amplitude (Awan et al., section VII.A)."""

START_SHARE: Final = 0.65
"""Expected share at which rendering starts: about two strokes in three, early enough for a person
who waits for it. Decision 55 compares other values."""

STOP_SHARE: Final = 0.84
"""Expected share at which modelling ends; most textures reach it within half a minute."""


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
        """Return whether a value is as good as a threshold, or better."""
        return value >= threshold if self.rises else value <= threshold


def usual_order(rate_hz: float) -> int:
    """Return the default order of filters at a sampling rate."""
    return min(LARGEST_ORDER, round(ORDER_AT_1_KHZ * max(1.0, rate_hz / 1e3)))


def surface_check_frames(rate_hz: float) -> int:
    """Return the number of frames (50 ms) between two checks for a change of surface."""
    return max(1, round(0.05 * rate_hz))


@dataclass(frozen=True)
class SurfaceSettings:
    """``[texture.surfaces]``: a model for each of several surfaces; see `mmt.texture.surfaces`."""

    false_alarms_per_hour: Annotated[float, Ge(0.001), Le(1000)] = 1.0
    """Expected false alarms of the change-point detection in an hour of stroking."""

    most: Annotated[int, Ge(2), Le(100)] = 20
    """Largest number of surfaces. Beyond it, a new one replaces the one left longest ago."""

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
    """Method of modelling: ``"field"`` models the level as a field with a known error,
    ``"published"`` follows Awan et al., or Abdulali and Jeon over velocity and force."""

    axis: VibrationAxis = "z"
    """Axis of the modelled acceleration; ``"dft321"`` combines all three."""

    normal: Axis = "z"
    """Normal axis of the surface. Force is taken along it, speed in the plane across it."""

    order: Order | Literal["auto"] = "auto"
    """Order of all autoregressive filters, 1 to 64; ``"auto"`` takes `usual_order` of the rate."""

    overlap_samples: Annotated[int, Ge(0), Le(2000)] = 200
    """Number of newest samples; a segment that reaches into them is not final yet."""

    straightness_mm: Annotated[float, Gt(0), Le(50)] = 1.0
    """Largest distance of the path from its chord inside a segment (tau_1)."""

    stationarity: Annotated[float, Gt(0), Le(1)] = 0.12
    """Largest coefficient of variation of speed and force inside a segment (tau_2)."""

    shortest_samples: Annotated[int, Ge(30), Le(2000)] = 120
    """Shortest segment."""

    longest_samples: Annotated[int, Ge(100), Le(5000)] = 1000
    """Longest segment; at least twice the shortest."""

    longest_bridged_samples: Annotated[int, Ge(0), Le(10)] = LONGEST_BRIDGED
    """Longest gap in frames that is filled, not counted as measured; longer ones end a segment."""

    least_speed_mm_s: Annotated[float, Gt(0), Le(300)] = 10.0
    """Slower motion is not modelled."""

    least_force_n: Annotated[float, Gt(0), Le(3)] = 0.1
    """Lighter contact is not modelled."""

    inputs: Inputs = "isotropic"
    """Inputs of the model: speed and force, or velocity vector and force."""

    start_distance: Distance = "auto"
    """Completion sum at which rendering starts (method ``"published"``)."""

    stop_distance: Distance = "auto"
    """Completion sum at which modelling ends; not above `start_distance`."""

    start_share: Share = "auto"
    """Expected share at which rendering starts (method ``"field"``)."""

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
        """Completion distances; the defaults of the inputs replace ``"auto"``."""
        usual = DISTANCES[self.inputs]
        return StartStop(
            usual.start if self.start_distance == "auto" else self.start_distance,
            usual.stop if self.stop_distance == "auto" else self.stop_distance,
        )

    @property
    def scale(self) -> CriterionScale:
        """Completion criterion of the method, with its thresholds."""
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
        """Order of the filters, with ``"auto"`` resolved."""
        if self.order != "auto":
            return self.order
        return usual_order(self.vibration_rate_hz)
