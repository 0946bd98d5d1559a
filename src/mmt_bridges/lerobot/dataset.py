"""Sessions as a LeRobot data set of format v3.0, with their 1 kHz frames beside it.

The files are those of LeRobot's own writer (lerobot 0.6, `lerobot.datasets`): rows in ``data``, one
row for each episode in ``meta/episodes``, ``meta/tasks.parquet``, ``meta/stats.json`` and
``meta/info.json``. LeRobot reads nothing else, so the folder ``mmt`` may hold the frames.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.existing import exists_error, replacing_folder
from mmt.core.frames import FRAMES_HZ, Channel
from mmt.session.data import RecordedSession, axis_columns
from mmt_bridges.lerobot.rows import (
    DATA_FOLDER,
    FELT,
    FORMAT,
    INFO_FILE,
    OF_EVERY_DATA_SET,
    STATE,
    Column,
    Feature,
    frames_file,
    low_rate_rows,
    statistics,
)

DEFAULT_FPS: Final = 50
DEFAULT_TASK: Final = "stroke the surface"

VIBRATION: Final = "vibration_rms_m_s2"
"""The last number of a state: root mean square of the acceleration over the row's period."""

_FIRST_FILE: Final = "chunk-000/file-000.parquet"
_PANDAS_COLUMN: Final = ("name", "field_name", "pandas_type", "numpy_type", "metadata")


def state_names(channels: Sequence[Channel]) -> tuple[str, ...]:
    """Return the names of a state's components, as in ``position_x_mm``."""
    names = [name for c in channels if c != "acceleration" for name in axis_columns(c)]
    return (*names, *([VIBRATION] if "acceleration" in channels else []))


def export_lerobot(
    sessions: Iterable[RecordedSession],
    folder: str | Path,
    *,
    fps: int = DEFAULT_FPS,
    task: str = DEFAULT_TASK,
    replace: bool = False,
) -> int:
    """Write sessions as the episodes of a LeRobot data set, and return its number of rows.

    A row stands for a period of 1 / `fps` s. Its ``observation.state`` has position and force of
    the newest frame in the period, and the root mean square of the acceleration over the period.
    Its ``observation.environment_state`` has the same without the position. Its ``action`` is the
    position of the next row. If frames are missing, the last values are held; ``mmt.frames`` counts
    the frames of each row. The frames themselves are in ``mmt/episode-000000.parquet`` and so on,
    as `mmt.export_session` writes them.

    Parameters
    ----------
    sessions
        Sessions with the same channels, at least one.
    folder
        Created. It may exist if it is empty or, with `replace`, if it is a LeRobot data set.
    fps
        Rows a second, 1 to 1000.
    task
        What is done in the sessions, for policies that take a task.
    replace
        Replace a LeRobot data set.

    Raises
    ------
    InputError
        pyarrow is not installed, the folder may not be written to or is in use, or a session
        has no rows, other channels, or values that are not finite.
    MmtError
        Writing failed; nothing is left behind.
    """
    require("pyarrow")
    if not 1 <= fps <= FRAMES_HZ:
        raise InputError(f"--fps {fps}: rows a second must be 1 to {FRAMES_HZ}")
    if not task.strip():
        raise InputError("--task: it must say what is done, in a few words")
    folder = Path(folder)
    in_use = folder.exists() and not (folder.is_dir() and not any(folder.iterdir()))
    if in_use and not (replace and (folder / INFO_FILE).is_file()):
        raise exists_error(folder)
    with replacing_folder(folder) as part:
        part.mkdir()
        writer = _Writer(part, fps)
        for session in sessions:
            writer.add(session)
        writer.finish(task)
        return writer.rows


class _Writer:
    def __init__(self, folder: Path, fps: int) -> None:
        self._folder = folder
        self._fps = fps
        self._features: dict[str, Feature] = {}
        self._episodes: list[dict[str, Column]] = []
        self.rows = 0

    def add(self, session: RecordedSession) -> None:
        from mmt.session.export_files import write_parquet

        features = _features(session.channels)
        if self._episodes and features != self._features:
            raise InputError(
                f"session {session.path}: it has {', '.join(session.channels)}, the sessions "
                "before it other channels; a data set has the same in every episode"
            )
        self._features = features
        episode = len(self._episodes)
        rows = low_rate_rows(session, self._fps)
        count = len(rows["frame_index"])
        rows["episode_index"] = np.full(count, episode)
        rows["index"] = np.arange(self.rows, self.rows + count)
        rows["task_index"] = np.zeros(count, dtype=np.int64)
        self._episodes.append(rows)
        self.rows += count
        file = frames_file(self._folder, episode)
        file.parent.mkdir(exist_ok=True)
        write_parquet(file, session)

    def finish(self, task: str) -> None:
        if not self._episodes:
            raise InputError("there is no session to export")
        self._write_rows()
        self._write_episodes(task)
        self._write_tasks(task)
        whole = {name: np.concatenate([e[name] for e in self._episodes]) for name in self._features}
        self._write_json("stats.json", statistics(whole))
        self._write_json("info.json", self._info())

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": FORMAT,
            "fps": self._fps,
            "features": {name: feature.as_dict() for name, feature in self._features.items()},
            "total_episodes": len(self._episodes),
            "total_frames": self.rows,
            "total_tasks": 1,
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "robot_type": "mmt",
            "splits": {"train": f"0:{len(self._episodes)}"},
        }

    def _write_rows(self) -> None:
        """Write the rows, each episode as a row group of its own, as LeRobot's writer does."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = pa.schema([(name, _arrow_type(f)) for name, f in self._features.items()])
        with pq.ParquetWriter(self._file(DATA_FOLDER, _FIRST_FILE), schema) as writer:
            for rows in self._episodes:
                columns = [
                    pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
                    if values.ndim == 2
                    else pa.array(values)
                    for values in (rows[name] for name in self._features)
                ]
                writer.write_table(pa.table(columns, schema=schema))

    def _write_episodes(self, task: str) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        lines = []
        for number, rows in enumerate(self._episodes):
            first = int(rows["index"][0])
            line: dict[str, Any] = {
                "episode_index": number,
                "tasks": [task],
                "length": len(rows["index"]),
                "data/chunk_index": 0,
                "data/file_index": 0,
                "dataset_from_index": first,
                "dataset_to_index": first + len(rows["index"]),
            }
            for feature, figures in statistics(rows).items():
                line |= {f"stats/{feature}/{name}": value for name, value in figures.items()}
            lines.append({**line, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        pq.write_table(pa.Table.from_pylist(lines), self._file("meta/episodes", _FIRST_FILE))

    def _write_tasks(self, task: str) -> None:
        """Write the tasks, which LeRobot reads by pandas with the task as the index."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = [
            dict(zip(_PANDAS_COLUMN, (name, name, *kinds, None), strict=True))
            for name, *kinds in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
        ]
        index = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
        table = pa.table({"task_index": pa.array([0]), "task": pa.array([task])})
        table = table.replace_schema_metadata({"pandas": json.dumps(index)})
        pq.write_table(table, self._file("meta", "tasks.parquet"))

    def _write_json(self, name: str, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False)
        self._file("meta", name).write_text(text, encoding="utf-8")

    def _file(self, *parts: str) -> Path:
        file = self._folder.joinpath(*parts)
        file.parent.mkdir(parents=True, exist_ok=True)
        return file


def _arrow_type(feature: Feature) -> Any:
    import pyarrow as pa

    value = pa.type_for_alias(feature.dtype)
    width = len(feature.names or "1")
    return value if width == 1 else pa.list_(value, width)


def _features(channels: Sequence[Channel]) -> dict[str, Feature]:
    """Return the features of rows in LeRobot's order: the robot's, then those of every data set."""
    features = {STATE: Feature("float32", state_names(channels))}
    felt = state_names([channel for channel in channels if channel != "position"])
    if felt:
        features[FELT] = Feature("float32", felt)
    if "position" in channels:
        features["action"] = Feature("float32", axis_columns("position"))
    features["mmt.frames"] = Feature("int64", ("frames",))
    return {**features, **OF_EVERY_DATA_SET}
