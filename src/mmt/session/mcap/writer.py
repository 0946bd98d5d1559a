"""Write a session file: MCAP, zstd, 64 KiB chunks.

`mmt.session.recorder` uses `SessionWriter` while a session runs, `write_mcap` writes a whole
session. ``docs/reference/session-file.md`` describes the layout.
"""

import json
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Final

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import __version__
from mmt.core.files.existing import replacing
from mmt.core.frames import FRAMES_HZ, MOST_SAMPLES, Channel, channels_of
from mmt.session.data import (
    FRAME_PERIOD_NS,
    JsonObject,
    RecordedSession,
    event_time_s,
    sampled_parts,
    to_json,
)
from mmt.session.mcap.messages import Codec, FrameCodec, OutputCodec, event_codec, pack_event
from mmt.session.mcap.plot_messages import (
    ACCELERATION_SAMPLE,
    SCALARS,
    LogCodec,
    PlotCodec,
    ScalarCodec,
    vibration_codec,
)

FORMAT_VERSION: Final = 3
"""Version of files with several samples of acceleration per frame."""
VERSION_AT_1_KHZ: Final = 2
"""Version of all other files, which older programs can read. Readers also accept version 1, with
events as JSON messages and without a date."""
FRAMES_PER_BLOCK: Final = 20
CHUNK_BYTES: Final = 64 * 1024
PROFILE: Final = "mmt"
LIBRARY: Final = f"mmt-haptics {__version__}"

FRAMES_TOPIC: Final = "/frames"
BACKFILL_TOPIC: Final = "/backfill"
PLOT_TOPIC: Final = "/plot"
OUTPUT_TOPIC: Final = "/output"
EVENTS_TOPIC: Final = "/events"
LOG_TOPIC: Final = "/log"
SCALARS_TOPIC: Final = "/scalars"
ACCELERATION_TOPIC: Final = "/acceleration"
VIBRATION_TOPIC: Final = "/vibration"

SESSION_METADATA: Final = "mmt.session"
SCENE_METADATA: Final = "mmt.scene"
UTC_OFFSET: Final = "utc_offset_ns"
"""Key of `SESSION_METADATA`: UTC minus the clock of the machine that recorded."""
ACCELERATION_RATE: Final = "acceleration_rate_hz"
"""Key of the metadata of topics, present if a frame has several samples of acceleration."""
RECOVERY_METADATA: Final = "mmt.recovery"

ANNOTATIONS_ATTACHMENT: Final = "annotations"
MODEL_ATTACHMENT: Final = "model"
MODEL_MEDIA_TYPE: Final = "application/x-npz"


class SessionWriter:
    """Writes one session file to an open stream, in the order of the calls.

    Without `finish`, ``mmt session recover`` can read the file up to the last `flush`.

    Parameters
    ----------
    stream
        The file. It is not closed.
    channels
        Channels of the frames.
    scene, session_id
        See `RecordedSession`.
    utc_offset_ns
        UTC minus the clock of the recording machine, which the methods' ``log_time_ns`` uses.
        The file's log times are UTC.
    scalars
        Also write each frame and each sample of the output as its own message, for tools that
        plot numbers.
    samples_per_frame
        Samples of acceleration, and of the output, per frame.
    """

    def __init__(
        self,
        stream: BinaryIO,
        channels: Sequence[Channel],
        scene: JsonObject | None = None,
        session_id: str | None = None,
        *,
        utc_offset_ns: int = 0,
        scalars: bool = False,
        samples_per_frame: int = 1,
    ) -> None:
        self._writer = open_writer(stream)
        self._frames = FrameCodec(channels, samples_per_frame)
        self._plot = PlotCodec(channels)
        self._output = OutputCodec()
        self._log = LogCodec()
        several = samples_per_frame > 1
        self._vibration = vibration_codec() if scalars else None
        self._scalars = {
            ACCELERATION_TOPIC if k > 1 else SCALARS_TOPIC: ScalarCodec(
                ACCELERATION_SAMPLE if k > 1 else SCALARS, part
            )
            for part, k in sampled_parts(channels, samples_per_frame)
            if scalars
        }
        self._codecs: dict[str, Codec] = {
            FRAMES_TOPIC: self._frames,
            BACKFILL_TOPIC: self._frames,
            PLOT_TOPIC: self._plot,
            OUTPUT_TOPIC: self._output,
            EVENTS_TOPIC: event_codec(),
            LOG_TOPIC: self._log,
            **self._scalars,
        }
        if self._vibration is not None:
            self._codecs[VIBRATION_TOPIC] = self._vibration
        self._utc_offset_ns = utc_offset_ns
        self._samples_per_frame = samples_per_frame
        self._models = 0
        rate = {ACCELERATION_RATE: str(1000 * samples_per_frame)} if several else {}
        self._metadata = dict.fromkeys((FRAMES_TOPIC, BACKFILL_TOPIC, OUTPUT_TOPIC), rate)
        self._writer.add_metadata(
            SESSION_METADATA,
            {
                "format_version": str(FORMAT_VERSION if several else VERSION_AT_1_KHZ),
                "rate_hz": "1000",
                **rate,
                "channels": ",".join(channels),
                "created_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
                UTC_OFFSET: str(utc_offset_ns),
                **({} if session_id is None else {"session_id": session_id}),
            },
        )
        if scene is not None:
            self._writer.add_metadata(SCENE_METADATA, {"json": to_json(dict(scene))})
        self._channels = {topic: self._register(topic) for topic in (FRAMES_TOPIC, PLOT_TOPIC)}

    def _register(self, topic: str) -> int:
        codec = self._codecs[topic]
        schema_id = self._writer.register_schema(codec.name, SchemaEncoding.Protobuf, codec.schema)
        metadata = self._metadata.get(topic, {})
        return self._writer.register_channel(topic, MessageEncoding.Protobuf, schema_id, metadata)

    def _add(
        self, topic: str, data: bytes, log_time_ns: int, time_ns: int, sequence: int = 0
    ) -> None:
        """Write a message; register its topic before the first."""
        if topic not in self._channels:
            self._channels[topic] = self._register(topic)
        self._writer.add_message(
            self._channels[topic], self._utc_ns(log_time_ns), data, max(0, time_ns), sequence
        )

    def _utc_ns(self, log_time_ns: int) -> int:
        return max(0, max(0, log_time_ns) + self._utc_offset_ns)

    def write_frames(
        self, frames: RecordArray, log_time_ns: int, topic: str = FRAMES_TOPIC
    ) -> None:
        """Write a block of frames (n,), n >= 1, as one message, and one message for plots."""
        time_ns, sequence = int(frames["time_ns"][0]), int(frames["sequence"][0])
        for each, data in (
            (topic, self._frames.encode(frames)),
            (PLOT_TOPIC, self._plot.encode(frames)),
        ):
            self._add(each, data, log_time_ns, time_ns, sequence)
        for plain, codec in self._scalars.items():
            for number, at_ns, data in codec.encode(frames):
                self._add(plain, data, log_time_ns + at_ns - time_ns, at_ns, number)

    def write_output(self, log_time_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Write a block of the leader's output, samples (n,) of one mode."""
        log_time_ns = max(0, log_time_ns)
        data = self._output.encode(log_time_ns, mode, vibration_m_s2)
        self._add(OUTPUT_TOPIC, data, log_time_ns, log_time_ns)
        if self._vibration is not None:
            for sample, value in enumerate(vibration_m_s2.tolist()):
                at_ns = log_time_ns + sample * FRAME_PERIOD_NS // self._samples_per_frame
                data = self._vibration.pack(time_ns=at_ns, vibration_m_s2=value)
                self._add(VIBRATION_TOPIC, data, at_ns, at_ns)

    def write_event(self, text: str, log_time_ns: int) -> None:
        """Write an event, the text of a JSON object, and its sentence as a log message."""
        event = json.loads(text)
        self._add(EVENTS_TOPIC, pack_event(event, text), log_time_ns, log_time_ns)
        sentence = event.get("event")
        if isinstance(sentence, str):
            data = self._log.encode(self._utc_ns(log_time_ns), sentence)
            self._add(LOG_TOPIC, data, log_time_ns, log_time_ns)

    def write_model(self, data: bytes, log_time_ns: int) -> None:
        """Attach a texture model's ``.npz``."""
        self._models += 1
        name = f"{MODEL_ATTACHMENT}-{self._models:04d}.npz"
        utc_ns = self._utc_ns(log_time_ns)
        self._writer.add_attachment(utc_ns, utc_ns, name, MODEL_MEDIA_TYPE, data)

    def write_annotations(self, data: bytes, log_time_ns: int) -> None:
        """Attach the follower's annotations, as bytes that are never parsed."""
        utc_ns = self._utc_ns(log_time_ns)
        self._writer.add_attachment(
            utc_ns, utc_ns, ANNOTATIONS_ATTACHMENT, "application/octet-stream", data
        )

    def flush(self) -> None:
        """End the current chunk and flush it to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Write the remaining data and the index; the stream is not closed."""
        self._writer.finish()  # type: ignore[no-untyped-call]


def open_writer(stream: BinaryIO) -> Writer:
    """Return an MCAP writer with the chunk size and compression of session files, started."""
    writer = Writer(
        stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
    )
    writer.start(profile=PROFILE, library=LIBRARY)
    return writer


def write_mcap(path: Path, session: RecordedSession, *, scalars: bool = False) -> None:
    """Write a whole session; an existing file is replaced when writing has succeeded.

    If `began_utc_ns` is None, the session is dated now. For `scalars` see `SessionWriter`.

    Raises
    ------
    InputError
        The folder is missing or not writable, or acceleration and output differ in rate.
    MmtError
        Writing failed, for instance because the disk is full.
    """
    with replacing(path) as part, part.open("wb") as stream:
        _write_all(stream, session, scalars=scalars)


def _write_all(stream: BinaryIO, session: RecordedSession, *, scalars: bool) -> None:
    frames = session.frames
    start_ns = max(0, int(frames["time_ns"][0])) if len(frames) else 0
    began_utc_ns = time.time_ns() if session.began_utc_ns is None else session.began_utc_ns
    found = {output.samples_per_frame for output in session.outputs}
    if "acceleration" in session.channels:
        found.add(session.samples_per_frame)
    if len(found) > 1:
        raise InputError(
            f"session {session.path}: acceleration and the leader's output are at "
            f"{' and '.join(str(FRAMES_HZ * k) for k in sorted(found))} Hz; a file holds one rate"
        )
    samples_per_frame = max(found, default=1)
    if not 1 <= samples_per_frame <= MOST_SAMPLES:
        raise InputError(
            f"session {session.path}: {samples_per_frame} samples of acceleration in a frame, a "
            f"file holds 1 to {MOST_SAMPLES}"
        )
    writer = SessionWriter(
        stream,
        channels_of(frames.dtype),
        session.scene,
        session.session_id,
        utc_offset_ns=began_utc_ns - start_ns,
        scalars=scalars,
        samples_per_frame=samples_per_frame,
    )

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
        writer.write_event(to_json(dict(event)), log_time_ns(event_time_s(event)))
    writer.finish()
