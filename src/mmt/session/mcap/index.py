"""Indexed session files: each chunk is read when a block of frames or a window needs it."""

from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from mcap.records import ChunkIndex, Message

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import Channel
from mmt.session.data import JsonObject
from mmt.session.mcap.reader import (
    annotations_of,
    frame_codec,
    is_complete,
    output_block,
    output_codec,
    recorded_event,
    scene_of,
    utc_offset_ns,
)
from mmt.session.mcap.records import problems_of
from mmt.session.mcap.scan import DAMAGE, Scan, chunk_messages, read_index
from mmt.session.mcap.writer import (
    ANNOTATIONS_ATTACHMENT,
    BACKFILL_TOPIC,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    OUTPUT_TOPIC,
    SESSION_METADATA,
)
from mmt.session.windows import Window, overlapping

_CHUNKS_TOGETHER: Final = 8
"""Chunks whose frames make one block, a few seconds of a session."""
_CHUNKS_KEPT: Final = 64
"""Size of the cache of decoded chunks: 30 s or more, some 100 KB each; playback reads each once."""


class IndexedSession:
    """A session file with an index, whose frames stay in it; any thread may read.

    `open` makes one. For its attributes see `mmt.session.windows.MemoryWindows`.
    """

    in_memory = False

    def __init__(self, path: Path, reader: Any, summary: Any) -> None:
        self.path = path
        self._every_chunk: list[ChunkIndex] = sorted(
            summary.chunk_indexes, key=lambda index: index.chunk_start_offset
        )
        self._chunks = [index for index in self._every_chunk if index.message_index_offsets]
        attached = [a for a in reader.iter_attachments() if a.name == ANNOTATIONS_ATTACHMENT]
        metadata = list(reader.iter_metadata())
        self._scan = scan = Scan(path, summary.schemas, summary.channels, [], attached, metadata)
        self._topics = {number: c.topic for number, c in summary.channels.items()}
        self.scene: JsonObject | None = scene_of(scan)
        self.annotations: bytes = annotations_of(scan)
        self.complete = is_complete(scan)
        self.session_id: str | None = scan.metadata_of(SESSION_METADATA).get("session_id")
        self._codec = frame_codec(scan)
        self.channels: tuple[Channel, ...] = self._codec.channels
        self.samples_per_frame = self._codec.samples_per_frame
        self._output_codec = output_codec(scan)
        self._utc_offset_ns = utc_offset_ns(scan) or 0
        self._part = lru_cache(_CHUNKS_KEPT)(self._read_part)
        first = next(self._on_topic(FRAMES_TOPIC), None)
        self.has_frames = first is not None
        self._start_ns = 0 if first is None else int(first.log_time)
        times_ns = [(index.message_start_time, index.message_end_time) for index in self._chunks]
        times_s = (np.array(times_ns, dtype=np.int64).reshape(-1, 2) - self._start_ns) / 1e9
        self._begins_s, self._ends_s = times_s[:, 0], times_s[:, 1]
        # a message has the time of its first sample, and lasts 20 ms or slightly longer
        self.duration_s = float(self._ends_s.max()) + 0.02
        self.has_output = self._output_codec is not None

    @classmethod
    def open(cls, path: Path) -> Self | None:
        """Open a file; None if it must be scanned, such as a cut-off one; see `read_index`.

        Raises
        ------
        InputError
            The file is not a session, of a newer version, or its scene is not valid.
        """
        try:
            with path.open("rb") as stream:
                found = read_index(path, stream)
                return None if found is None else cls(path, *found)
        except (*DAMAGE, OSError):
            return None

    @classmethod
    def open_in_order(cls, path: Path) -> Self | None:
        """Open a file for `blocks`; None if it must be read whole.

        That is the case if it has back-filled frames, or any damage. Raises as `open` does.
        """
        session = cls.open(path)
        if session is None or BACKFILL_TOPIC in session._topics.values():
            return None
        with path.open("rb") as stream:
            return None if problems_of(stream) else session

    @cached_property
    def events(self) -> Sequence[JsonObject]:
        """The events in order, each with its recording time as ``at_s``; reads the file."""
        events = (
            recorded_event(self._scan, m, self._start_ns) for m in self._on_topic(EVENTS_TOPIC)
        )
        timed = [{**event, "at_s": event["time_s"]} for event in events]
        return sorted(timed, key=lambda event: float(event["at_s"]))

    def blocks(self) -> Iterator[RecordArray]:
        """Yield the frames (n,) of a few chunks at a time; each call starts at the beginning.

        Raises
        ------
        InputError
            A chunk is damaged; the message says how to recover the file.
        """
        for first in range(0, len(self._every_chunk), _CHUNKS_TOGETHER):
            messages: list[Message] = []
            for index in self._every_chunk[first : first + _CHUNKS_TOGETHER]:
                try:
                    messages += chunk_messages(self.path, index)
                except (*DAMAGE, OSError) as error:
                    raise InputError(
                        f"session {self.path}: a chunk cannot be read ({error}); save what is "
                        f"readable with: mmt session recover {self.path}"
                    ) from error
            live = (m for m in messages if self._topics.get(m.channel_id) == FRAMES_TOPIC)
            yield self._codec.decode([message.data for message in live])

    def window(self, begin_s: float, end_s: float) -> Window:
        """See `mmt.session.windows.MemoryWindows.window`.

        Takes a few milliseconds for each chunk (0.5 to 1 s of the session) that is not cached.
        """
        near = (self._begins_s < end_s) & (self._ends_s >= begin_s)
        # the index has the time of a message's first sample: the last message before the window
        # may reach into the window, from any earlier time if it spans a gap
        before = np.flatnonzero(self._ends_s < begin_s)
        if len(before):
            near[before[np.argmax(self._ends_s[before])]] = True
        read = [self._part(number) for number in np.flatnonzero(near).tolist()]
        parts = [part for part, _ in read]
        if not parts:
            return Window(np.zeros(0), np.zeros(0, dtype=self._codec.dtype))
        frames = np.concatenate([part.frames for part in parts])
        time_s = np.concatenate([part.time_s for part in parts])
        inside = (time_s >= begin_s) & (time_s < end_s)
        frames, time_s = frames[inside], time_s[inside]
        if any(late for _, late in read):
            order = np.argsort(frames["sequence"], kind="stable")
            frames, time_s = frames[order], np.maximum.accumulate(time_s[order])
        arrivals = np.concatenate([part.arrivals for part in parts])
        arrived_s = (arrivals[:, 0] + self._utc_offset_ns - self._start_ns) / 1e9
        outputs = overlapping([o for part in parts for o in part.outputs], begin_s, end_s)
        return Window(
            time_s, frames, outputs, arrivals[(arrived_s >= begin_s) & (arrived_s < end_s)]
        )

    # ---

    def _on_topic(self, topic: str) -> Iterator[Message]:
        """Yield the messages of a topic, in the order of the file."""
        ids = {number for number, name in self._topics.items() if name == topic}
        for index in self._chunks:
            if ids & index.message_index_offsets.keys():
                yield from (m for m in self._messages(index) if m.channel_id in ids)

    def _messages(self, index: ChunkIndex) -> list[Message]:
        """Return the messages of a chunk, or none if the chunk is damaged."""
        try:
            return chunk_messages(self.path, index)
        except (*DAMAGE, OSError):
            return []

    def _read_part(self, number: int) -> tuple[Window, bool]:
        """Decode a chunk, and say whether it has back-filled frames; `_part` caches this."""
        messages = self._messages(self._chunks[number])
        live, late, outputs = (
            [m for m in messages if self._topics.get(m.channel_id) == topic]
            for topic in (FRAMES_TOPIC, BACKFILL_TOPIC, OUTPUT_TOPIC)
        )
        frames, time_s = (
            np.concatenate(c) for c in zip(*map(self._frames, (live, late)), strict=True)
        )
        arrivals = np.array(
            [(m.log_time - self._utc_offset_ns, m.publish_time) for m in live], dtype=np.int64
        )
        codec = self._output_codec
        blocks = [output_block(self._scan, codec, m, self._start_ns) for m in outputs if codec]
        return Window(time_s, frames, blocks, arrivals.reshape(-1, 2)), bool(late)

    def _frames(self, messages: list[Message]) -> tuple[RecordArray, FloatArray]:
        """Return the frames (n,) of blocks, and the recording time (n,) of each by arrival.

        One call parses all blocks, 50 times faster than one by one. The sequence of a block's
        first frame marks its beginning.
        """
        frames = self._codec.decode([message.data for message in messages])
        firsts = np.array([message.sequence for message in messages], dtype=np.int64)
        numbers = frames["sequence"].astype(np.int64)
        ascending = bool((np.diff(numbers) > 0).all())
        if len(messages) > 1 and not (ascending and np.isin(firsts, numbers).all()):
            pieces = [self._frames([message]) for message in messages]
            frames, time_s = (np.concatenate(columns) for columns in zip(*pieces, strict=True))
            return frames, time_s
        arrived_ns = np.array([message.log_time for message in messages], dtype=np.int64)
        # a single block from another program may have a different message sequence
        begins = np.searchsorted(numbers, firsts) if len(messages) > 1 else np.array([0])
        block = np.searchsorted(begins, np.arange(len(frames)), side="right") - 1
        since_ns = frames["time_ns"] - frames["time_ns"][begins[block]]
        return frames, np.asarray((arrived_ns[block] - self._start_ns + since_ns) / 1e9)
