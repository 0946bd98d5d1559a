"""Force feedback on recorded contacts of a bilateral teleoperator with one degree of freedom.

The files hold the angles of both levers and the torque of the environment
(``docs/reference/evaluation.md``). The recorded hand moves the handle; the recorded follower
and its force come back late. The error is the displayed force less the force of the environment
that was recorded at the same instant of the hand, without the delay.
"""

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.contact.estimation import ContactModel
from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.files.untrusted import load_arrays
from mmt.core.frames import empty_frames
from mmt.evaluation.model_errors import root_mean_square
from mmt.leader.motion.feedback_model import ModelForce
from mmt_lab.feedback.sides import Display, Method, Sides, handle_state, make_sides

DELAYS_MS: Final = (0, 20, 50, 100, 200)
"""One way; the force comes back after twice this."""

RATE_HZ: Final = 1000
LIMIT_N: Final = 40.0
SETTLED: Final = 0.2
"""The model has settled when its stiffness stays within this share of its last value."""

_REFERENCE_N: Final = 1.0
_CONTACT_N: Final = 0.2
_ARRAYS: Final = (
    "time_s",
    "leader_position_rad",
    "follower_position_rad",
    "environment_torque_nm",
    "arm_length_m",
)


@dataclass(frozen=True)
class RecordedRun:
    """A recorded run at 1 kHz, along the axis into the object that is touched.

    Attributes
    ----------
    name
        Name of the file, without its suffix.
    hand_m, tool_m
        Depth of the hand's handle and of the follower's tool, (n,).
    force_n
        Force of the environment, (n,), positive against the depth.
    """

    name: str
    hand_m: FloatArray
    tool_m: FloatArray
    force_n: FloatArray

    @property
    def contact(self) -> str:
        """The object that was touched: the last word of the file's name."""
        return self.name.rpartition("_")[2]

    @property
    def opening_j(self) -> float:
        """Initial energy of a passivity account, for a recording that begins in contact.

        It is the most that the recorded contact gives back in one stretch; 0 if it begins free.
        """
        if self.force_n[0] < _CONTACT_N:
            return 0.0
        work = np.cumsum(self.force_n[:-1] * np.diff(self.hand_m))
        return float(np.max(np.maximum.accumulate(work) - work))


@dataclass(frozen=True)
class RecordedResult:
    """Result of a method on a run with a delay.

    Attributes
    ----------
    run, contact, method, delay_ms
        The cell; the delay is one way.
    force_error_n
        Root mean square of displayed less true force, from the first round trip on.
    force_n
        Root mean square of the true force over the same time.
    energy_mj
        Largest energy that the hand had received beyond what it had put in.
    settled_s
        Time from which the model's stiffness stays within a fifth of its last value, or None.
    surface, felt
        Estimated contact at the tool, and contact rendered to the hand; None without a model.
    """

    run: str
    contact: str
    method: Method
    delay_ms: int
    force_error_n: float
    force_n: float
    energy_mj: float
    settled_s: float | None = None
    surface: ContactModel | None = None
    felt: ContactModel | None = None


def read_run(path: Path) -> RecordedRun:
    """Read a run and resample it to 1 kHz.

    The sign of the force differs between the files. It is chosen so that the largest force pushes
    back; depth grows with the angle.
    """
    try:
        loaded, _ = load_arrays(path)
        arrays = {n: np.asarray(loaded[n], dtype=float) for n in _ARRAYS if n in loaded}
    except (OSError, InputError, ValueError) as error:
        raise InputError(f"{path}: no recording of a bilateral teleoperator: {error}") from error
    missing = [name for name in _ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{path}: no array {missing[0]!r}: needed are {_ARRAYS}")
    lengths = {arrays[name].shape for name in _ARRAYS[:-1]}
    if len(lengths) != 1 or arrays["time_s"].ndim != 1 or len(arrays["time_s"]) < 2:
        raise InputError(f"{path}: the arrays must have one length, and one dimension")
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise InputError(f"{path}: some of its numbers are not finite")
    source_s, longest_s = arrays["time_s"], 2e-3 * max(DELAYS_MS)
    if (np.diff(source_s) < 0.0).any() or np.ptp(source_s) <= longest_s:
        raise InputError(f"{path}: time_s must ascend, over more than {longest_s:g} s")
    if arrays["arm_length_m"].size != 1 or not arrays["arm_length_m"].all():
        raise InputError(f"{path}: arm_length_m must be one number, and not 0")
    arm_m = float(arrays["arm_length_m"].item())
    time_s = np.arange(source_s[0], source_s[-1], 1.0 / RATE_HZ)
    force_n = np.interp(time_s, source_s, arrays["environment_torque_nm"]) / arm_m
    return RecordedRun(
        name=path.stem,
        hand_m=arm_m * np.interp(time_s, source_s, arrays["leader_position_rad"]),
        tool_m=arm_m * np.interp(time_s, source_s, arrays["follower_position_rad"]),
        force_n=force_n * np.sign(force_n[np.argmax(np.abs(force_n))]),
    )


def find_runs(paths: list[Path]) -> list[Path]:
    """Return the named files, and the .npz files of named folders in sorted order."""
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.glob("[!.]*.npz")) if path.is_dir() else [path]
        if not inside or not inside[0].exists():
            raise InputError(f"{path}: no recording there: name .npz files or their folder")
        found += inside
    return found


def evaluate_run(run: RecordedRun, method: Method, delay_ms: int) -> RecordedResult:
    """Replay a run with a method and a delay."""
    display = Display()
    sides = make_sides(method, display, limit_n=LIMIT_N, opening_j=run.opening_j)
    shown, stiffness = _replay(run, sides, display, delay_ms)
    known = slice(2 * delay_ms, None)
    error = shown[known] - run.force_n[known]
    net = np.cumsum(-shown[:-1] * np.diff(run.hand_m))
    model = sides.leader if isinstance(sides.leader, ModelForce) else None
    return RecordedResult(
        run.name,
        run.contact,
        method,
        delay_ms,
        force_error_n=root_mean_square(error),
        force_n=root_mean_square(run.force_n[known]),
        energy_mj=1e3 * max(0.0, float(net.max())),
        settled_s=_settled_s(stiffness),
        surface=model.surface if model is not None else None,
        felt=model.contact_model if model is not None else None,
    )


def _replay(
    run: RecordedRun, sides: Sides, display: Display, delay_ms: int
) -> tuple[FloatArray, FloatArray]:
    """Return the displayed force and the rendered stiffness, each (n,)."""
    frames = _frames(run)
    hands = run.hand_m.tolist()
    sent: deque[tuple[int, RecordArray]] = deque()
    shown, stiffness = np.zeros(len(hands)), np.zeros(len(hands))
    for tick, hand_m in enumerate(hands):
        past = tick - 2 * delay_ms
        if past >= 0:
            frame = frames[past : past + 1]
            if sides.follower is not None:
                while sent and sent[0][0] <= past:
                    sides.follower.on_records(sent.popleft()[1])
                sides.follower.command((0.0, 0.0, -1e3 * hands[past]))
                records = sides.follower.measured(frame)
                if records is not None:
                    sides.leader.on_records(records)
            sides.leader.on_frames(frame)
        news = sides.leader.tick(1, handle_state(-hand_m))
        if news is not None:
            sent.append((tick, news))
        shown[tick] = display.force_n
        if isinstance(sides.leader, ModelForce) and sides.leader.contact_model is not None:
            stiffness[tick] = sides.leader.contact_model.stiffness_at(_REFERENCE_N)
    return shown, stiffness


def _frames(run: RecordedRun) -> RecordArray:
    frames = empty_frames(len(run.force_n), ("position", "force"))
    frames["sequence"] = np.arange(len(frames))
    frames["position_mm"][:, 2] = -1e3 * run.tool_m
    frames["force_n"][:, 2] = run.force_n
    return frames


def _settled_s(stiffness: FloatArray) -> float | None:
    """Return the time from which the stiffness stays near its last value, None if that is 0."""
    last = float(stiffness[-1])
    if last == 0.0:
        return None
    away = np.flatnonzero(np.abs(stiffness - last) > SETTLED * last)
    return float(away[-1] + 1) / RATE_HZ if len(away) else 0.0


def model_table(model: ContactModel | None) -> dict[str, Any] | None:
    """Return an estimate as a dictionary for JSON, or None."""
    if model is None:
        return None
    return {
        "stiffness_n_m": model.stiffness_at(_REFERENCE_N),
        "exponent": model.exponent,
        "damping_n_s_m": model.damping_n_s_m,
        "dissipation_s_m": model.dissipation_s_m,
    }
