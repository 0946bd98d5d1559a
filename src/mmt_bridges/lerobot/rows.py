"""A LeRobot data set of format v3.0: its layout, and the rows of a session at its rate."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import IntArray
from mmt.core.errors import InputError
from mmt.core.frames import FIELD_OF_CHANNEL, FRAMES_HZ, acceleration_samples
from mmt.session.data import RecordedSession

FORMAT: Final = "v3.0"
"""The format that is written."""
INFO_FILE: Final = Path("meta", "info.json")
"""The file that marks a folder as a LeRobot data set."""
DATA_FOLDER: Final = "data"

Column: TypeAlias = npt.NDArray[Any]
"""Values (n,), or (n, k) of a feature with k components."""

STATE: Final = "observation.state"
FELT: Final = "observation.environment_state"
"""Force and vibration once more: LeRobot's policies without pictures need an environment's state,
which has this name."""

_LONGEST_GAP_S: Final = 600
_FIGURES: Final[Mapping[str, Callable[..., Any]]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "std": np.std,
}
_QUANTILES: Final = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


@dataclass(frozen=True)
class Feature:
    """The type of a column, and the names of its components."""

    dtype: str
    names: Sequence[str] | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the feature as in ``meta/info.json``."""
        return {"dtype": self.dtype, "shape": [len(self.names or "1")], "names": self.names}


OF_EVERY_DATA_SET: Final = {
    "timestamp": Feature("float32"),
    **{name: Feature("int64") for name in ("frame_index", "episode_index", "index", "task_index")},
}


def frames_file(folder: Path, episode: int) -> Path:
    """Return the file with the 1 kHz frames of an episode."""
    return folder / "mmt" / f"episode-{episode:06}.parquet"


def low_rate_rows(session: RecordedSession, fps: int) -> dict[str, Column]:
    """Return the rows of a session, by feature, see `export_lerobot`.

    Row k stands for the frames whose number, counted from the first, is at least k / `fps` and
    below (k + 1) / `fps` seconds; the frames of an unfinished period at the end have none. If the
    numbers fall, because the follower was started anew, counting goes on.

    Raises
    ------
    InputError
        There is no whole row, a gap is longer than 10 minutes, or a value is not finite.
    """
    frames, where = session.frames, f"session {session.path}"
    steps = np.diff(frames["sequence"].astype(np.int64))
    steps[steps < 1] = 1
    if len(steps) and steps.max() > _LONGEST_GAP_S * FRAMES_HZ:
        raise InputError(
            f"{where}: {steps.max() / FRAMES_HZ:.0f} s of frames are missing in one place; rows "
            f"have no gaps, and no more than {_LONGEST_GAP_S} s are held"
        )
    numbers = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(steps)])
    row_of_frame = numbers[: len(frames)] * fps // FRAMES_HZ
    count = int(numbers[-1] + 1) * fps // FRAMES_HZ
    if len(frames) == 0 or count == 0:
        raise InputError(
            f"{where}: its {len(frames)} frames make no row of {1000 / fps:.3g} ms, an episode "
            "needs one"
        )
    newest = np.searchsorted(row_of_frame, np.arange(count), side="right") - 1
    states = {
        c: _vibration(
            acceleration_samples(frames), row_of_frame.repeat(session.samples_per_frame), count
        )
        if c == "acceleration"
        else frames[FIELD_OF_CHANNEL[c]][newest]
        for c in sorted(session.channels, key="acceleration".__eq__)  # as in `state_names`
    }
    state = np.concatenate(list(states.values()), axis=1)
    bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
    if len(bad):
        raise InputError(f"{where}: a value at {bad[0] / fps:.3f} s is not finite")
    index = np.arange(count)
    rows: dict[str, Column] = {STATE: _column(state)}
    felt = [values for channel, values in states.items() if channel != "position"]
    if felt:
        rows[FELT] = _column(np.concatenate(felt, axis=1))
    if "position" in session.channels:
        rows["action"] = state[np.minimum(index + 1, count - 1), :3]
    rows["mmt.frames"] = np.bincount(row_of_frame, minlength=count)[:count]
    rows["timestamp"] = (index / fps).astype(np.float32)
    rows["frame_index"] = index
    return rows


def _column(values: npt.NDArray[np.float32]) -> Column:
    """Return values (n, k) as LeRobot's rows have them: (n,) for a single component."""
    return values if values.shape[1] > 1 else values[:, 0]


def _vibration(
    acceleration_m_s2: npt.NDArray[np.float32], row_of_sample: IntArray, count: int
) -> npt.NDArray[np.float32]:
    """Return the rms (n, 1) of each row's acceleration, mean removed, all three axes together."""
    row = row_of_sample[row_of_sample < count]
    samples = np.bincount(row, minlength=count)
    filled = np.maximum(samples, 1)
    variance = np.zeros(count)
    for axis in acceleration_m_s2[: len(row)].astype(np.float64).T:
        mean = np.bincount(row, axis, minlength=count) / filled
        variance += np.bincount(row, (axis - mean[row]) ** 2, minlength=count) / filled
    held = np.maximum.accumulate(np.where(samples > 0, np.arange(count), 0))
    return np.sqrt(variance[held, None]).astype(np.float32)


def statistics(rows: Mapping[str, Column]) -> dict[str, dict[str, list[Any]]]:
    """Return the figures of each component of each feature, by which LeRobot normalises.

    Quantiles are exact; LeRobot's own writer estimates them by histograms.
    """
    found = {}
    for name, column in rows.items():
        values = column.astype(np.float64).reshape(len(column), -1)
        figures = {figure: f(values, axis=0).tolist() for figure, f in _FIGURES.items()}
        figures["count"] = [len(values)]
        figures |= {q: np.quantile(values, at, axis=0).tolist() for q, at in _QUANTILES.items()}
        found[name] = figures
    return found
