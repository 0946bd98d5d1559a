"""The load of a tool on the force sensor that carries it: its weight and its inertia.

A force sensor between hand and tool, or robot and tool, measures the force of the surface and what
holds up and accelerates the tool. An accelerometer that is fixed to the tool measures the proper
acceleration f: the acceleration minus that of gravity. So the force of the surface is the measured
one plus ``mass R f``, with the rotation R from the accelerometer's axes to the force sensor's,
however the tool is tilted. This holds for an accelerometer at the tool's centre of mass. At another
place ``a x r + v x (v x r)`` is added to f, where r leads to the centre, and v and a are the
angular velocity and acceleration, known if frames have the tool's orientation. The rest of a
tool's inertia acts on torques alone, which frames do not hold.

Mass and rotation are identified from poses at rest by least squares: the rotation by the singular
value decomposition of the covariance (Umeyama, "Least-squares estimation of transformation
parameters between two point patterns", IEEE Trans. PAMI 13 (1991), 376-380); then the centre of
mass from a tool that is turned free in the air, by linear least squares.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray, Vector
from mmt.core.errors import InputError, MmtError
from mmt.core.frames import acceleration_samples
from mmt.core.units import GRAVITY_M_S2
from mmt.devices.calibrations import finite_vector
from mmt.devices.protocols import Accelerometer, ForceSensor, SampledSensor
from mmt.devices.reading_checks import measured
from mmt.devices.streaming.tool_turning import DELAY, SPAN, TurningEstimator

CALIBRATED_AS: Final = "tool"
"""Name of these calibrations among the stored ones."""

REST_S: Final = 0.2
"""Duration of a mean at rest."""

Sensor = ForceSensor | Accelerometer | SampledSensor

_AGAIN: Final = "calibrate again with mmt device calibrate SCENE --tool NAME"
_FEW: Final = 20
"""Fewer readings make no mean."""
_MOVED_M_S2: Final = 0.5
"""Standard deviation from which the tool counts as moving."""
_FLAT: Final = 0.3
"""Least spread of the poses along each axis, in parts of gravity."""
_OFF_SHARE: Final = 0.1
"""Largest residual, in parts of the tool's weight."""
_LEAST_OFF_N: Final = 0.05
"""Residual (N) that is allowed for any tool."""
_LEAST_SURE_M: Final = 0.01
"""Largest standard deviation of the centre of mass along any axis."""


class Pose(NamedTuple):
    """Means at rest, with the tool held free."""

    force_n: Vector
    proper_acceleration_m_s2: Vector


@dataclass(frozen=True)
class ToolLoad:
    """Mass of a tool, and how its accelerometer is turned against its force sensor."""

    mass_kg: float
    rotation: tuple[Vector, Vector, Vector]
    """Rows of the matrix from the accelerometer's axes to the force sensor's."""
    residual_n: float = 0.0
    """Largest difference of a pose from the fit."""
    centre_m: Vector | None = None
    """From the accelerometer to the centre of mass, in the tool's axes; None if unknown."""

    def as_dict(self) -> dict[str, Any]:
        """Return the values as they are stored."""
        return asdict(self)


class LoadRemover:
    """Removes the load of a tool from the force of frames.

    Parameters
    ----------
    load
        The load.
    """

    def __init__(self, load: ToolLoad) -> None:
        self._per_m_s2 = load.mass_kg * np.array(load.rotation).T
        self._centre_m = None if load.centre_m is None else np.array(load.centre_m)
        self._turning = TurningEstimator()
        self._at_rest_m_s2 = np.zeros(3)

    def learn_rest(self, accelerometer: Sensor) -> None:
        """Read the connected accelerometer while the tool is at rest as for the force's bias.

        The bias contains the weight in this pose.

        Raises
        ------
        MmtError
            The accelerometer gives too few readings.
        """
        (proper,) = readings_at_rest({"accelerometer": accelerometer}, REST_S).values()
        self._at_rest_m_s2 = proper.mean(axis=0)

    def remove(self, frames: RecordArray) -> None:
        """Remove the load from frames (n,) with force and acceleration, in place.

        If they have the orientation too, the centre of mass counts as well as it is known.
        """
        proper = _newest(frames) - self._at_rest_m_s2
        if self._centre_m is not None and "orientation" in (frames.dtype.names or ()):
            for row, frame in enumerate(frames):
                turning = self._turning.step(int(frame["sequence"]), frame["orientation"])
                if turning is not None:
                    proper[row] += turning.matrix() @ self._centre_m
        frames["force_n"] += proper @ self._per_m_s2


def _newest(frames: RecordArray) -> FloatArray:
    """Return the newest acceleration of each frame, (n, 3)."""
    return acceleration_samples(frames).reshape(len(frames), -1, 3)[:, -1].astype(np.float64)


def load_from(content: Mapping[str, Any]) -> ToolLoad:
    """Return a stored load.

    Raises
    ------
    InputError
        A value is missing or impossible.
    """
    try:
        first, second, third = (finite_vector(row) for row in content["rotation"])
        mass_kg, residual_n = float(content["mass_kg"]), float(content["residual_n"])
        centre = content.get("centre_m")
        centre_m = None if centre is None else finite_vector(centre)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the stored load of the tool is damaged ({error}): {_AGAIN}") from error
    turn = np.array([first, second, third])
    if not 0.0 < mass_kg < 100.0 or np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6:
        raise InputError(f"the stored load of the tool is impossible: {_AGAIN}")
    return ToolLoad(mass_kg, (first, second, third), residual_n, centre_m)


def identify(poses: Sequence[Pose]) -> ToolLoad:
    """Identify a tool's load from four or more poses at rest.

    Raises
    ------
    InputError
        The poses are too few or too alike, or contradict each other; the message names the pose.
    """
    force = np.array([pose.force_n for pose in poses]).reshape(-1, 3)
    proper = np.array([pose.proper_acceleration_m_s2 for pose in poses]).reshape(-1, 3)
    for number, felt in enumerate(np.linalg.norm(proper, axis=1), 1):
        if abs(felt / GRAVITY_M_S2 - 1.0) > _OFF_SHARE:
            raise InputError(
                f"pose {number}: the accelerometer feels {felt:.2f} m/s2 at rest, gravity is "
                f"{GRAVITY_M_S2:.2f}: calibrate the accelerometer first"
            )
    count = max(len(poses), 1)
    away, load = proper - proper.sum(axis=0) / count, force.sum(axis=0) / count - force
    spreads = np.linalg.svd(away / np.sqrt(count), compute_uv=False)
    if len(poses) < 4 or spreads[-1] < _FLAT * GRAVITY_M_S2:
        raise InputError(
            f"{len(poses)} poses, too alike: hold the tool so that each of its axes points up and "
            "down, six poses are best"
        )
    left, sizes, right = np.linalg.svd(load.T @ away)
    mirrored = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    rotation = (left * mirrored) @ right
    mass_kg = float(mirrored @ sizes / np.square(away).sum())
    if mass_kg * GRAVITY_M_S2 < _LEAST_OFF_N:
        raise InputError(
            f"the force changes by {mass_kg * GRAVITY_M_S2:.2g} N from pose to pose: the force "
            "sensor carries no tool, or does not feel it"
        )
    off_n = np.linalg.norm(load - mass_kg * away @ rotation.T, axis=1)
    worst = int(off_n.argmax())
    if off_n[worst] > max(_LEAST_OFF_N, _OFF_SHARE * mass_kg * GRAVITY_M_S2):
        raise InputError(
            f"pose {worst + 1} is {off_n[worst]:.2f} N off the load of {1e3 * mass_kg:.0f} g that "
            "fits all: something touched the tool, its cable pulls, or the accelerometer is not "
            "fixed to the tool"
        )
    first, second, third = (finite_vector(row) for row in rotation)
    return ToolLoad(mass_kg, (first, second, third), float(off_n[worst]))


def with_centre(load: ToolLoad, frames: RecordArray) -> ToolLoad:
    """Return a load with its centre of mass, from frames (n,) of a tool turned free in the air.

    Raises
    ------
    InputError
        Something touched the tool, or it was turned too little.
    """
    proper, numbers = _newest(frames), frames["sequence"].astype(np.int64)
    felt = frames["force_n"] @ (-np.array(load.rotation) / load.mass_kg) - proper
    estimator = TurningEstimator()
    matrices, sought = [], []
    for number, orientation in zip(numbers.tolist(), frames["orientation"], strict=True):
        turning = estimator.step(number, orientation)
        place = int(np.searchsorted(numbers, number - DELAY))
        if turning is not None and numbers[place] == number - DELAY:
            matrices.append(turning.matrix())
            sought.append(felt[place])
    count = max(len(sought), 1)
    known, wanted = np.array(matrices).reshape(-1, 3, 3), np.array(sought).reshape(-1, 3)
    known, wanted = known - known.sum(axis=0) / count, wanted - wanted.sum(axis=0) / count
    centre_m = np.linalg.lstsq(known.reshape(-1, 3), wanted.ravel(), rcond=None)[0]
    off_n = load.mass_kg * float(np.sqrt(np.square(wanted - known @ centre_m).sum() / count))
    if off_n > max(_LEAST_OFF_N, _OFF_SHARE * load.mass_kg * GRAVITY_M_S2):
        raise InputError(
            f"the force is {off_n:.2f} N rms off that of a rigid tool: something touched it, or "
            "rotation_deg and axes of the sensors do not lead to the tool's axes"
        )
    least = np.linalg.eigvalsh(np.einsum("nij,nik->jk", known, known))[0]
    error_m_s2 = max(off_n, _LEAST_OFF_N) / load.mass_kg  # independent once in `SPAN` frames
    if least * _LEAST_SURE_M**2 < SPAN * error_m_s2**2:
        raise InputError(
            "the tool was turned too little to tell its centre of mass within "
            f"{1e3 * _LEAST_SURE_M:.0f} mm: turn it more quickly, and about each of its axes"
        )
    return replace(load, centre_m=finite_vector(centre_m))


def readings_at_rest(sensors: Mapping[str, Sensor], duration_s: float) -> dict[str, FloatArray]:
    """Read connected sensors for a time, and return the readings (n, 3) of each, by its name.

    Raises
    ------
    MmtError
        A sensor gives too few readings.
    """
    found: dict[str, list[Vector]] = {name: [] for name in sensors}
    until_s = time.monotonic() + duration_s
    while time.monotonic() < until_s:
        for name, sensor in sensors.items():
            read: Any = sensor.read()
            sampled = hasattr(sensor, "latency_ns")
            values = [reading.value for reading in read or ()] if sampled else [read]
            found[name] += [value for value in values if measured(value) is not None]
        time.sleep(0.001)
    for name, values in found.items():
        if len(values) < _FEW:
            raise MmtError(f"{name}: {len(values)} readings came in {duration_s:g} s, too few")
    return {name: np.array(values) for name, values in found.items()}


def measure_pose(force_sensor: Sensor, accelerometer: Sensor, duration_s: float) -> Pose:
    """Measure a pose with the tool at rest, in the hand or on a stand.

    Raises
    ------
    InputError
        The tool moved meanwhile.
    MmtError
        A sensor gives too few readings.
    """
    sensors = {"force sensor": force_sensor, "accelerometer": accelerometer}
    force, proper = readings_at_rest(sensors, duration_s).values()
    moved = float(proper.std(axis=0).max())
    if moved > _MOVED_M_S2:
        raise InputError(
            f"the tool moved (its acceleration varied by {moved:.2f} m/s2): hold it still and "
            "measure again"
        )
    return Pose(finite_vector(force.mean(axis=0)), finite_vector(proper.mean(axis=0)))
