"""Rebuild the model of a recorded session in a thread, with all its states.

The model is updated as by the live leader: once per period, not while it was frozen, from scratch
after a reset, and no more once the stop criterion is met. If surfaces are distinguished, each has
a model, and the recorded statements of users count. Models are stored on disk, so that an hour of
states needs little memory.
"""

import tempfile
import threading
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray, RecordArray
from mmt.core.errors import MmtError
from mmt.session.data import JsonObject
from mmt.session.stream import SessionWindows
from mmt.texture.completion.criterion import Progress
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.modeller_factory import ModellerFactory
from mmt.texture.online.history import stream_blocks
from mmt.texture.online.methods import method_of
from mmt.texture.online.updates import ModelUpdate, surface_statements
from mmt.texture.settings import ModellingSettings

_MODELS_KEPT: Final = 8
"""Number of most recently used models that are kept in memory."""


class ModelSnapshots:
    """Stores models by number in a temporary file, which is deleted on `close`.

    One thread may add while another reads.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="mmt-models-")  # noqa: SIM115 - see `close`
        self._places: list[tuple[int, int]] = []
        self._lock = threading.Lock()
        self.model = lru_cache(_MODELS_KEPT)(self._read)
        """Return a model by its number."""

    def __len__(self) -> int:
        return len(self._places)

    def add(self, model: TextureModel) -> int:
        """Store a model and return its number; takes a few kB, at most about 100 kB."""
        data = model.to_bytes()
        with self._lock:
            place = self._file.seek(0, 2)
            self._file.write(data)
            self._places.append((place, len(data)))
            return len(self._places) - 1

    def close(self) -> None:
        """Delete all models."""
        with self._lock:
            self._file.close()

    def _read(self, number: int) -> TextureModel:
        with self._lock:
            place, size = self._places[number]
            self._file.seek(place)
            data = self._file.read(size)
        return TextureModel.from_bytes(data)


_SPAN_S: Final = 5.0
"""Length of the recording that is read at once."""

Span = tuple[float, float]


@dataclass(frozen=True)
class ModelState:
    """State of the model from a recording time on.

    ``progress`` is the value of the completion criterion. ``number`` is the number of the
    model's snapshot, or None without a model. ``start_s`` and ``stop_s`` are the recording times
    at which the criteria were met, or None before. If surfaces are distinguished, all values are
    for ``surface``, one of ``surfaces`` known ones. ``faults`` describes invalid samples.
    """

    time_s: float
    progress: Progress
    number: int | None
    start_s: float | None
    stop_s: float | None
    surface: int | None = None
    surfaces: int = 0
    faults: str = ""


class ModelRebuild:
    """Rebuilds all states of a recording's model; each is available once it is computed.

    Parameters
    ----------
    windows
        The recording.
    settings
        Settings of the modelling.
    period_s
        Time between two updates.
    """

    def __init__(
        self, windows: SessionWindows, settings: ModellingSettings, period_s: float
    ) -> None:
        self._windows = windows
        self._settings = settings
        self._modellers = ModellerFactory(settings, period_s)
        self._frozen = frozen_spans(windows.events, windows.duration_s)
        self.snapshots = ModelSnapshots()
        """The models, by `ModelState.number`."""
        self._leave = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mmt-rebuilding", daemon=True)
        self.states: list[ModelState] = []
        """States in order of time; the thread only appends."""
        self.reached_s = 0.0
        """Recording time up to which the states are known."""
        self.done = False
        self.problem: str | None = None
        """Why rebuilding ended early, or None."""

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, and close the snapshots."""
        self._leave.set()
        if self._thread.ident is not None:
            self._thread.join()
        self.snapshots.close()

    def at(self, time_s: float) -> ModelState | None:
        """Return the state at a recording time, or None before the first update."""
        states = self.states
        place = bisect_right(states, time_s, key=lambda state: state.time_s)
        return states[place - 1] if place else None

    # --- in the thread

    def _run(self) -> None:
        try:
            resets = [e["at_s"] for e in self._windows.events if e.get("event") == "model reset"]
            edges_s = [0.0, *sorted(max(0.0, float(at_s)) for at_s in resets), np.inf]
            for number, begin_s in enumerate(edges_s[:-1]):
                if number:
                    empty = method_of(self._settings).criterion.progress
                    self.states.append(ModelState(begin_s, empty, None, None, None))
                self._build((begin_s, min(edges_s[number + 1], self._windows.duration_s)))
                if self._leave.is_set():
                    return
        except MmtError as error:
            self.problem = str(error)
        except Exception as error:  # noqa: BLE001 - the page goes on without a model, and says why
            self.problem = f"{type(error).__name__}: {error}"
        finally:
            self.reached_s = self._windows.duration_s
            self.done = True

    def _build(self, span: Span) -> None:
        """Build one model over a span, until the model is complete or the span ends."""
        growing = _Growing(self.snapshots)
        events = [e for e in self._windows.events if span[0] <= e["at_s"] < span[1]]
        modeller = self._modellers.make(surface_statements(events))
        for time_s, frames in self._blocks(span):
            update = modeller.update(frames)
            self.reached_s = time_s
            if update is not None:
                self.states.append(growing.state(update, time_s))
            if self._leave.is_set() or (update is not None and self._modellers.is_finished(update)):
                return

    def _blocks(self, span: Span) -> Iterator[tuple[float, RecordArray]]:
        """Yield the frames of each update, with the recording time of the newest frame.

        Late frames may lie a few milliseconds off, so the last two blocks of each reading wait
        for the next one. The leader never used the last, incomplete period before a reset; at
        the end of the recording it did.
        """
        begin_s, span_end_s = span
        waiting: list[tuple[FloatArray, RecordArray]] = []
        while begin_s < span_end_s:
            end_s = min(begin_s + _SPAN_S, span_end_s)
            window = self._windows.window(begin_s, end_s)
            kept = ~in_spans(window.time_s, self._frozen)
            waiting.append((window.time_s[kept], window.frames[kept]))
            times_s, frames = (np.concatenate(columns) for columns in zip(*waiting, strict=True))
            blocks = list(stream_blocks([frames], self._modellers.frames_at_once))
            done = len(blocks) - self._unused(blocks, end_s, span_end_s)
            place = 0
            for block in blocks[:done]:
                place += len(block)
                yield float(times_s[place - 1]), block
            waiting = [(times_s[place:], frames[place:])]
            begin_s = end_s
            self.reached_s = max(self.reached_s, begin_s - _SPAN_S)

    def _unused(self, blocks: Sequence[RecordArray], end_s: float, span_end_s: float) -> int:
        """Return how many of the last blocks to hold back for the next reading, or to discard."""
        if end_s < span_end_s:
            return min(2, len(blocks))
        if end_s >= self._windows.duration_s or not blocks:
            return 0
        last = blocks[-1]["sequence"]
        return int(int(last[-1]) - int(last[0]) + 1 < self._modellers.frames_at_once)


class _Growing:
    """Derives the model's states from its updates, for each surface."""

    def __init__(self, snapshots: ModelSnapshots) -> None:
        self._snapshots = snapshots
        self._numbers: dict[int | None, tuple[TextureModel, int]] = {}
        self._started: dict[int | None, float] = {}
        self._stopped: dict[int | None, float] = {}
        self._known: set[int | None] = set()

    def state(self, update: ModelUpdate, time_s: float) -> ModelState:
        for change in update.changes:
            self._known |= {change.before, change.surface}
            if change.kind == "identified":
                self._known.remove(change.before)
        self._known.add(update.surface)
        for one in (*update.left, update):
            self._note(one, time_s)
        surface = update.surface
        return ModelState(
            time_s=time_s,
            progress=update.progress,
            number=self._number(update),
            start_s=self._started.get(surface),
            stop_s=self._stopped.get(surface),
            surface=surface,
            surfaces=0 if surface is None else len(self._known),
            faults=update.faults.sentence(),
        )

    def _note(self, update: ModelUpdate, time_s: float) -> None:
        """Store when the criteria were met, or clear the times if they no longer are."""
        for met, times in ((update.started, self._started), (update.stopped, self._stopped)):
            if met:
                times.setdefault(update.surface, time_s)
            else:
                times.pop(update.surface, None)

    def _number(self, update: ModelUpdate) -> int | None:
        """Return the number of the model's snapshot; an unchanged model keeps its number."""
        model = update.model
        if model is None:
            return None
        before = self._numbers.get(update.surface)
        if before is None or before[0] is not model:
            self._numbers[update.surface] = model, self._snapshots.add(model)
        return self._numbers[update.surface][1]


def frozen_spans(events: Sequence[JsonObject], end_s: float) -> list[Span]:
    """Return the spans during which the model was frozen, in recording time."""
    spans: list[Span] = []
    since_s: float | None = None
    for event in events:
        frozen = event.get("frozen")
        if event.get("event") == "model reset":
            frozen = False
        if frozen is True and since_s is None:
            since_s = float(event["at_s"])
        elif frozen is False and since_s is not None:
            spans.append((since_s, float(event["at_s"])))
            since_s = None
    return spans if since_s is None else [*spans, (since_s, end_s)]


def in_spans(time_s: FloatArray, spans: Sequence[Span]) -> BoolArray:
    """Return whether each time (n,) lies in one of the spans."""
    inside = np.zeros(len(time_s), dtype=np.bool_)
    for begin_s, end_s in spans:
        inside |= (time_s >= begin_s) & (time_s < end_s)
    return inside
