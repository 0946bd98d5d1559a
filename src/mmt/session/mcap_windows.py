"""Windows of an indexed session file: each chunk is read when a window needs it."""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, Final, Self

import numpy as np
from mcap.records import ChunkIndex, Message

from mmt.core.arrays import FloatArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import Channel
from mmt.session.data import JsonObject, OutputBlock, json_object
from mmt.session.mcap_reader import (
    frame_codec,
    output_block,
    recorded_event,
    scanned_session,
    utc_offset_ns,
)
from mmt.session.mcap_scan import DAMAGE, chunk_messages, read_index, scan_mcap
from mmt.session.mcap_writer import (
    BACKFILL_TOPIC,
    EVENTS_TOPIC,
    FRAMES_TOPIC,
    OUTPUT_TOPIC,
    SCENE_METADATA,
    SESSION_METADATA,
)
from mmt.session.messages import OutputCodec
from mmt.session.windows import MemoryWindows, SessionWindows, Window, overlapping

_CHUNKS_KEPT: Final = 64
"""Size of the cache of decoded chunks: 30 s or more, some 100 KB each; playback reads each once."""


@dataclass(frozen=True, eq=False)
class _Part:
    """The decoded content of one chunk."""

    time_s: FloatArray
    frames: RecordArray
    outputs: list[OutputBlock]
    arrivals: IntArray
    late: bool


class McapWindows:
    """Windows of a session file with an index; see `mmt.session.windows.SessionWindows`."""

    in_memory = False

    def __init__(self, path: Path, stream: BinaryIO, reader: Any, summary: Any) -> None:
        self.path = path
        self._stream = stream
        self._chunks: list[ChunkIndex] = sorted(
            (index for index in summary.chunk_indexes if index.message_index_offsets),
            key=lambda index: index.chunk_start_offset,
        )
        self._mcap_channels = summary.channels
        self._topics = {number: c.topic for number, c in summary.channels.items()}
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        scene = metadata.get(SCENE_METADATA, {}).get("json")
        self.scene: JsonObject | None = (
            None if scene is None else json_object(scene, f"session {path}: the scene")
        )
        about = metadata.get(SESSION_METADATA, {})
        self.session_id: str | None = about.get("session_id")
        self._codec = frame_codec(path, summary.channels, summary.schemas, about)
        self.channels: tuple[Channel, ...] = self._codec.channels
        self.samples_per_frame = self._codec.samples_per_frame
        schemas = {c.topic: summary.schemas.get(c.schema_id) for c in summary.channels.values()}
        output_schema = schemas.get(OUTPUT_TOPIC)
        self._output_codec = OutputCodec(output_schema.data) if output_schema else None
        self._utc_offset_ns = utc_offset_ns(about) or 0
        self._part = lru_cache(_CHUNKS_KEPT)(self._read_part)
        self._start_ns = self._first_frame_ns()
        self._begins_s, self._ends_s = (
            (np.array(times_ns, dtype=np.int64) - self._start_ns) / 1e9
            for times_ns in (
                [index.message_start_time for index in self._chunks],
                [index.message_end_time for index in self._chunks],
            )
        )
        # a message has the time of its first sample, and lasts 20 ms or slightly longer
        self.duration_s = float(self._ends_s.max()) + 0.02
        self.has_output = self._output_codec is not None
        self.events: Sequence[JsonObject] = self._read_events()

    @classmethod
    def open(cls, path: Path) -> Self | None:
        """Open a file; None if it must be scanned, such as a cut-off one; see `read_index`.

        Raises
        ------
        InputError
            The file is missing, not a session, or holds no frames.
        """
        try:
            stream = path.open("rb")
        except OSError as error:
            raise InputError(f"session {path}: {error.strerror or error}") from error
        try:
            found = read_index(path, stream)
            if found is None:
                stream.close()
                return None
            return cls(path, stream, *found)
        except (*DAMAGE, OSError):
            stream.close()
            return None
        except InputError:
            stream.close()
            raise

    def window(self, begin_s: float, end_s: float) -> Window:
        """See `mmt.session.windows.SessionWindows.window`.

        Takes a few milliseconds for each chunk (0.5 to 1 s of the session) that is not cached.
        """
        near = (self._begins_s < end_s) & (self._ends_s >= begin_s)
        # the index has the time of a message's first sample: the last message before the window
        # may reach into the window, from any earlier time if it spans a gap
        before = np.flatnonzero(self._ends_s < begin_s)
        if len(before):
            near[before[np.argmax(self._ends_s[before])]] = True
        parts = [self._part(int(number)) for number in np.flatnonzero(near)]
        if not parts:
            return Window(np.zeros(0), np.zeros(0, dtype=self._codec.dtype))
        frames = np.concatenate([part.frames for part in parts])
        time_s = np.concatenate([part.time_s for part in parts])
        inside = (time_s >= begin_s) & (time_s < end_s)
        frames, time_s = frames[inside], time_s[inside]
        if any(part.late for part in parts):
            order = np.argsort(frames["sequence"], kind="stable")
            frames, time_s = frames[order], np.maximum.accumulate(time_s[order])
        arrivals = np.concatenate([part.arrivals for part in parts])
        arrived_s = (arrivals[:, 0] + self._utc_offset_ns - self._start_ns) / 1e9
        outputs = overlapping([o for part in parts for o in part.outputs], begin_s, end_s)
        return Window(
            time_s, frames, outputs, arrivals[(arrived_s >= begin_s) & (arrived_s < end_s)]
        )

    def reopen(self) -> Self:
        """See `mmt.session.windows.SessionWindows.reopen`."""
        other = copy(self)
        other._stream = self.path.open("rb")
        other._part = lru_cache(_CHUNKS_KEPT)(other._read_part)
        return other

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    # ---

    def _first_frame_ns(self) -> int:
        first = next(self._on_topic(FRAMES_TOPIC), None)
        if first is None:
            raise InputError(f"session {self.path}: it holds no frames")
        return int(first.log_time)

    def _on_topic(self, topic: str) -> Iterator[Message]:
        """Yield the messages of a topic, in the order of the file."""
        ids = {number for number, name in self._topics.items() if name == topic}
        for index in self._chunks:
            if ids & index.message_index_offsets.keys():
                yield from (m for m in self._messages(index) if m.channel_id in ids)

    def _messages(self, index: ChunkIndex) -> list[Message]:
        """Return the messages of a chunk, or none if the chunk is damaged."""
        try:
            return chunk_messages(self._stream, index)
        except DAMAGE:
            return []

    def _read_events(self) -> list[JsonObject]:
        events = (
            recorded_event(self.path, m, self._mcap_channels[m.channel_id], self._start_ns)
            for m in self._on_topic(EVENTS_TOPIC)
        )
        timed = [{**event, "at_s": event["time_s"]} for event in events]
        return sorted(timed, key=lambda event: float(event["at_s"]))

    def _read_part(self, number: int) -> _Part:
        """Decode a chunk; `_part` does so from a cache if possible."""
        messages = self._messages(self._chunks[number])
        live = [m for m in messages if self._topics.get(m.channel_id) == FRAMES_TOPIC]
        late = [m for m in messages if self._topics.get(m.channel_id) == BACKFILL_TOPIC]
        outputs = [m for m in messages if self._topics.get(m.channel_id) == OUTPUT_TOPIC]
        frames, time_s = (
            np.concatenate(c) for c in zip(*map(self._frames, (live, late)), strict=True)
        )
        arrivals = np.array(
            [(m.log_time - self._utc_offset_ns, m.publish_time) for m in live], dtype=np.int64
        )
        return _Part(
            time_s=time_s,
            frames=frames,
            outputs=[self._output(m) for m in outputs],
            arrivals=arrivals.reshape(-1, 2),
            late=bool(late),
        )

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

    def _output(self, message: Message) -> OutputBlock:
        assert self._output_codec is not None  # noqa: S101 - the topic has a schema
        channel = self._mcap_channels[message.channel_id]
        return output_block(self.path, self._output_codec, message, channel, self._start_ns)


def open_windows(path: str | Path) -> SessionWindows:
    """Open a session file of any readable format.

    An ``.mcap`` file is read by its index, a few chunks for each window. A cut-off file and
    files of other formats have no index and are read into memory.

    Raises
    ------
    InputError
        The file is missing, of an unknown format, not valid, or holds no frames.
    """
    from mmt.session.files import read_session

    path = Path(path)
    if path.suffix.lower() != ".mcap":
        return MemoryWindows(read_session(path))
    indexed = McapWindows.open(path)
    return indexed if indexed is not None else MemoryWindows(scanned_session(scan_mcap(path)))
