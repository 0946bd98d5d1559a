"""Write a session file: MCAP, zstd, 64 KiB chunks; no thread, no clock.

`mmt.session.recorder` uses it while a session runs, `write_mcap` for a whole session.
The layout is in ``docs/reference/session-file.md``.
"""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import Channel, channels_of
from mmt.core.version import __version__
from mmt.session.data import JsonObject, RecordedSession, to_json
from mmt.session.files import replacing
from mmt.session.messages import (
    EVENT_SCHEMA,
    FRAME_BLOCK,
    OUTPUT_BLOCK,
    PLOT_SAMPLE,
    FrameCodec,
    OutputCodec,
    PlotCodec,
    frame_schema,
    output_schema,
    plot_schema,
)

FORMAT_VERSION: Final = 1
FRAMES_PER_BLOCK: Final = 20
CHUNK_BYTES: Final = 64 * 1024
PROFILE: Final = "mmt"
LIBRARY: Final = f"mmt-haptics {__version__}"

FRAMES_TOPIC: Final = "/frames"
BACKFILL_TOPIC: Final = "/backfill"
PLOT_TOPIC: Final = "/plot"
OUTPUT_TOPIC: Final = "/output"
EVENTS_TOPIC: Final = "/events"

SESSION_METADATA: Final = "mmt.session"
SCENE_METADATA: Final = "mmt.scene"
RECOVERY_METADATA: Final = "mmt.recovery"

ANNOTATIONS_ATTACHMENT: Final = "annotations"
MODEL_ATTACHMENT: Final = "model"
MODEL_MEDIA_TYPE: Final = "application/x-npz"

_SAMPLE_BYTES = 4


class SessionWriter:
    """Write one session file to an open stream, in the order of the calls.

    Times are ``log_time_ns``: the clock of the machine that records. A file that lacks
    `finish` is readable up to its last `flush` by ``mmt session recover``.
    """

    def __init__(
        self,
        stream: BinaryIO,
        channels: Sequence[Channel],
        scene: JsonObject | None = None,
        session_id: str | None = None,
    ) -> None:
        self._writer = open_writer(stream)
        self._frames = FrameCodec.of_channels(channels)
        self._plot = PlotCodec(channels)
        self._output = OutputCodec()
        self._models = 0
        self._writer.add_metadata(
            SESSION_METADATA,
            {
                "format_version": str(FORMAT_VERSION),
                "rate_hz": "1000",
                "channels": ",".join(channels),
                "created_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
                **({} if session_id is None else {"session_id": session_id}),
            },
        )
        if scene is not None:
            self._writer.add_metadata(SCENE_METADATA, {"json": to_json(dict(scene))})
        self._frame_schema = frame_schema(channels)
        self._frames_id = self._register(
            FRAMES_TOPIC, FRAME_BLOCK, SchemaEncoding.Protobuf, self._frame_schema
        )
        self._backfill_id: int | None = None
        self._plot_id = self._register(
            PLOT_TOPIC, PLOT_SAMPLE, SchemaEncoding.Protobuf, plot_schema(channels)
        )
        self._output_id: int | None = None
        self._events_id: int | None = None

    def _register(self, topic: str, schema: str, encoding: str, data: bytes) -> int:
        schema_id = self._writer.register_schema(schema, encoding, data)
        json_encoded = encoding == SchemaEncoding.JSONSchema
        message = MessageEncoding.JSON if json_encoded else MessageEncoding.Protobuf
        return self._writer.register_channel(topic, message, schema_id)

    def write_frames(self, frames: RecordArray, log_time_ns: int) -> None:
        """Write a block of frames (n,), n >= 1, as one message, and its plot sample."""
        self._write_block(self._frames_id, frames, log_time_ns)

    def write_backfill(self, frames: RecordArray, log_time_ns: int) -> None:
        """Write a block of frames (n,), n >= 1, that came late, as `write_frames`."""
        if self._backfill_id is None:
            self._backfill_id = self._register(
                BACKFILL_TOPIC, FRAME_BLOCK, SchemaEncoding.Protobuf, self._frame_schema
            )
        self._write_block(self._backfill_id, frames, log_time_ns)

    def _write_block(self, frames_id: int, frames: RecordArray, log_time_ns: int) -> None:
        time_ns = max(0, int(frames["time_ns"][0]))
        sequence = int(frames["sequence"][0])
        for channel_id, data in (
            (frames_id, self._frames.encode(frames)),
            (self._plot_id, self._plot.encode(frames)),
        ):
            self._writer.add_message(channel_id, log_time_ns, data, time_ns, sequence)

    def write_output(self, log_time_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Write a block of the leader's output, samples (n,) of one mode."""
        if self._output_id is None:
            self._output_id = self._register(
                OUTPUT_TOPIC, OUTPUT_BLOCK, SchemaEncoding.Protobuf, output_schema()
            )
        log_time_ns = max(0, log_time_ns)
        data = self._output.encode(log_time_ns, mode, vibration_m_s2)
        self._writer.add_message(self._output_id, log_time_ns, data, log_time_ns)

    def write_event(self, event: str, log_time_ns: int) -> None:
        """Write an event, a JSON object as text."""
        if self._events_id is None:
            self._events_id = self._register(
                EVENTS_TOPIC, "mmt.Event", SchemaEncoding.JSONSchema, EVENT_SCHEMA
            )
        self._writer.add_message(self._events_id, log_time_ns, event.encode(), log_time_ns)

    def write_model(self, data: bytes, log_time_ns: int) -> None:
        """Attach a texture model's ``.npz``."""
        self._models += 1
        name = f"{MODEL_ATTACHMENT}-{self._models:04d}.npz"
        self._writer.add_attachment(log_time_ns, log_time_ns, name, MODEL_MEDIA_TYPE, data)

    def write_annotations(self, data: bytes, log_time_ns: int) -> None:
        """Attach the follower's annotations, bytes that are stored and never opened."""
        self._writer.add_attachment(
            log_time_ns, log_time_ns, ANNOTATIONS_ATTACHMENT, "application/octet-stream", data
        )

    def flush(self) -> None:
        """End the chunk in progress and hand everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the rest and the index; the stream stays open."""
        self._writer.finish()  # type: ignore[no-untyped-call]


def open_writer(stream: BinaryIO) -> Writer:
    """Return a started MCAP writer with the chunk size and compression of session files."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start(profile=PROFILE, library=LIBRARY)
    return writer


def write_mcap(path: Path, session: RecordedSession) -> None:
    """Write a whole session; an existing file is replaced, but only by a finished one.

    Raises
    ------
    InputError
        The folder does not exist or may not be written.
    MmtError
        Writing failed, for instance because the disk is full.
    """
    with replacing(path) as part, part.open("wb") as stream:
        _write_all(stream, session)


def _write_all(stream: BinaryIO, session: RecordedSession) -> None:
    frames = session.frames
    writer = SessionWriter(stream, channels_of(frames.dtype), session.scene, session.session_id)
    start_ns = max(0, int(frames["time_ns"][0])) if len(frames) else 0

    def log_time_ns(time_s: float) -> int:
        return max(0, start_ns + round(time_s * 1e9))

    if session.annotations:
        writer.write_annotations(session.annotations, start_ns)
    for time_s, model in session.models:
        writer.write_model(model, log_time_ns(time_s))
    for first in range(0, len(frames), FRAMES_PER_BLOCK):
        block = frames[first : first + FRAMES_PER_BLOCK]
        writer.write_frames(block, max(0, int(block["time_ns"][0])))
    for output in session.outputs:
        writer.write_output(log_time_ns(output.time_s), output.mode, output.vibration_m_s2)
    for event in session.events:
        writer.write_event(to_json(dict(event)), log_time_ns(float(event.get("time_s", 0.0))))
    writer.finish()


class FrameAssembler:
    """Join frames into blocks of 20; `write` gets each with its first frame's log time."""

    def __init__(self, dtype: np.dtype[Any], write: Callable[[RecordArray, int], None]) -> None:
        self._dtype = dtype
        self._write = write
        self._block_bytes = FRAMES_PER_BLOCK * dtype.itemsize
        self._waiting = bytearray()
        self._log_time_ns = 0

    def add(self, log_time_ns: int, data: bytes) -> None:
        """Append frames as bytes and write every block that is full."""
        if not self._waiting:
            self._log_time_ns = log_time_ns
        self._waiting += data
        while len(self._waiting) >= self._block_bytes:
            self._write_block(self._block_bytes)
            self._log_time_ns = log_time_ns

    def flush(self) -> None:
        """Write the rest as a block that is not full."""
        if self._waiting:
            self._write_block(len(self._waiting))

    def _write_block(self, size: int) -> None:
        block = bytes(self._waiting[:size])
        del self._waiting[:size]
        self._write(np.frombuffer(block, dtype=self._dtype), self._log_time_ns)


class OutputAssembler:
    """Join output samples of one mode into blocks of 20 or a little more."""

    def __init__(self, write: Callable[[int, str, FloatArray], None]) -> None:
        self._write = write
        self._waiting = bytearray()
        self._mode = ""
        self._time_ns = 0

    def add(self, time_ns: int, mode: str, data: bytes) -> None:
        """Append little-endian float32 samples; a new mode begins a new block."""
        if mode != self._mode:
            self.flush()
        if not self._waiting:
            self._mode, self._time_ns = mode, time_ns
        self._waiting += data
        if len(self._waiting) >= FRAMES_PER_BLOCK * _SAMPLE_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the rest."""
        if self._waiting:
            samples = np.frombuffer(bytes(self._waiting), dtype="<f4").astype(np.float64)
            self._waiting.clear()
            self._write(self._time_ns, self._mode, samples)
