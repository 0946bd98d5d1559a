"""Layout of a LeRobot data set of format v3.0, for its writer and its reader."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

FORMAT: Final = "v3.0"
"""The format that is written, and the only one that is read."""
INFO_FILE: Final = Path("meta", "info.json")
"""The file that marks a folder as a LeRobot data set."""
DATA_FOLDER: Final = "data"


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
