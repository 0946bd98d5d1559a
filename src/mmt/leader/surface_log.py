"""Which surface the tool was on and when, and how complete the model of each is."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.errors import MmtError
from mmt.scene import Replay
from mmt.texture.online.updates import (
    ModelUpdate,
    SurfaceChange,
    SurfaceStatement,
    surface_statements,
)

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel

_SENTENCES: Final = {
    "new": "surface {0.surface}, not known before, from {1:.2f} s on",
    "recalled": "surface {0.surface} again, from {1:.2f} s on",
    "identified": "surface {0.before} is surface {0.surface}, from {1:.2f} s on",
}
_LONGEST: Final = 10_000
"""Largest number of stays and of changes in memory; older ones are in the recording."""


@dataclass
class SurfaceEntry:
    """Log of one surface.

    ``stays``: session times of the begin and the end of each stay of the tool; the end is None
    while the stay lasts. ``start_s`` and ``stop_s``: when the surface's model met the criteria.
    """

    samples: int = 0
    distance: float | None = None
    start_s: float | None = None
    stop_s: float | None = None
    stays: list[tuple[float, float | None]] = field(default_factory=list)

    def record(self, update: ModelUpdate, time_s: float) -> None:
        """Record the state of the surface's model."""
        self.samples, self.distance = update.samples, update.distance
        self.start_s = (
            (time_s if self.start_s is None else self.start_s) if update.started else None
        )
        self.stop_s = (time_s if self.stop_s is None else self.stop_s) if update.stopped else None

    def leave(self, time_s: float) -> None:
        """Note that the tool left."""
        begun_s, _ = self.stays[-1]
        self.stays[-1] = (begun_s, time_s)

    def as_dict(self, end_s: float) -> dict[str, Any]:
        """Return the entry as a dictionary; an open stay lasts until `end_s`."""
        return {
            "samples": self.samples,
            "distance": None if self.distance is None else round(self.distance, 3),
            "start_s": self.start_s,
            "stop_s": self.stop_s,
            "stays": [
                {"from_s": round(a, 3), "to_s": round(end_s if b is None else b, 3)}
                for a, b in self.stays
            ],
        }


class SurfaceLog:
    """Log the updates of the model for each surface, from session time `since_s` on."""

    def __init__(self, since_s: float = 0.0) -> None:
        self._since_s = since_s
        self.current = 1
        """The number of the surface that the tool is assumed to be on."""
        self.entries: dict[int, SurfaceEntry] = {1: SurfaceEntry(stays=[(since_s, None)])}
        """Entries by number, including surfaces that the leader has forgotten."""
        self.changes: list[dict[str, Any]] = []

    @property
    def known(self) -> int:
        """Number of surfaces told apart so far."""
        return len(self.entries)

    @property
    def entry(self) -> SurfaceEntry:
        """Entry of the surface that the tool is on."""
        return self.entries[self.current]

    def record(self, update: ModelUpdate) -> list[tuple[str, dict[str, Any]]]:
        """Record an update, with ``time_s`` in session time.

        Return a sentence and details for each change of surface.
        """
        left = iter(update.left)
        told = []
        for change in update.changes:
            if change.kind == "identified":
                from_s = self._identify(change)
            else:
                state = next(left)
                from_s = self._since_s + state.time_s
                self._go(change, state, from_s)
            found = {"found_s": round(update.time_s, 3), "kind": change.kind}
            found |= {"surface": change.surface, "from_s": round(from_s, 3)}
            self.changes.append(found)
            told.append((_SENTENCES[change.kind].format(change, from_s), asdict(change) | found))
        self.entry.record(update, update.time_s)
        del self.changes[:-_LONGEST]
        return told

    def _go(self, change: SurfaceChange, state: ModelUpdate, from_s: float) -> None:
        before = self.entries[change.before]
        before.record(state, from_s)
        before.leave(from_s)
        entry = self.entries.setdefault(change.surface, SurfaceEntry())
        entry.stays.append((from_s, None))
        del entry.stays[:-_LONGEST]
        self.current = change.surface

    def _identify(self, change: SurfaceChange) -> float:
        """Merge the current surface into the known one that it is; return when its stay began."""
        entry = self.entries[change.surface]
        stays = self.entries.pop(change.before).stays
        entry.stays += stays
        self.current = change.surface
        return stays[0][0]

    def as_dict(self, end_s: float) -> dict[str, Any]:
        """Return the whole log as a dictionary, at the session's end."""
        return {
            "now": self.current,
            "known": self.known,
            "changes": self.changes,
            **{str(number): entry.as_dict(end_s) for number, entry in sorted(self.entries.items())},
        }


def replayed_words(replay: Replay) -> list[SurfaceStatement]:
    """Return the surfaces that persons named in the session that is replayed.

    Their sequence numbers are those of the replay, which begin at 0. Empty if the file is not on
    this machine, or if gaps are closed up, which moves the numbers.
    """
    from mmt.session.stream import open_windows

    if replay.file is None or replay.gaps != "keep" or not replay.file.is_file():
        return []
    session = open_windows(replay.file)
    words = surface_statements(session.events)
    beginning = session.window(0.0, min(1.0, session.duration_s)).frames["sequence"]
    first = int(beginning[0]) if len(beginning) else 0
    return [SurfaceStatement(max(0, word.sample - first), word.surface) for word in words]


def write_surface_models(recording: Path, models: "Mapping[int, TextureModel]") -> list[str]:
    """Write a model file for each surface; delete those of an earlier recording of that name.

    Returns
    -------
    problems
        A sentence for each file that could not be written.
    """
    ours = re.compile(re.escape(recording.stem) + r"-surface-[0-9]+\.npz")
    with suppress(OSError):
        for old in recording.parent.iterdir():
            if ours.fullmatch(old.name):
                old.unlink()
    problems = []
    for number, model in models.items():
        path = recording.with_name(f"{recording.stem}-surface-{number}.npz")
        try:
            model.save(path)
        except MmtError as error:
            problems.append(f"the model of surface {number}: {error}")
    return problems
