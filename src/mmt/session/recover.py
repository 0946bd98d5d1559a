"""Recover the readable part of a session file that was cut off or damaged."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mmt.core.errors import InputError
from mmt.core.files.existing import replacing
from mmt.core.files.untrusted import json_object
from mmt.session.data import duration_s, missing_frames
from mmt.session.mcap.reader import parse_event, scanned_frames
from mmt.session.mcap.scan import Scan, scan_mcap
from mmt.session.mcap.writer import EVENTS_TOPIC, RECOVERY_METADATA, SCENE_METADATA, open_writer


@dataclass(frozen=True)
class Recovery:
    """Result of `recover`."""

    path: Path
    """The new file."""
    frames: int
    missing_frames: int
    """Frames missing in the new file: lost in transmission, or with a damaged chunk."""
    duration_s: float
    chunks: int
    damaged_chunks: int
    problem: str
    """Problem of the original file; empty if there was none."""


def recover(path: str | Path, out: str | Path) -> Recovery:
    """Write every readable record of a session file into a new, complete file.

    A chunk that was cut off or damaged is lost, since it is compressed as one block. A recorder
    ends a chunk every 0.5 s or less, so a crash loses at most that much. The original file is not
    changed.

    Raises
    ------
    InputError
        The file is missing, of another format, or has nothing readable, or `out` is the
        same file or cannot be made.
    MmtError
        Writing failed.
    """
    path, out = Path(path), Path(out)
    if out.exists() and path.exists() and out.samefile(path):
        raise InputError(f"recover {path}: name another file to write to, this one is kept")
    scan = scan_mcap(path)
    frames = scanned_frames(scan)
    recovery = Recovery(
        path=out,
        frames=len(frames),
        missing_frames=missing_frames(frames),
        duration_s=duration_s(frames),
        chunks=scan.chunks,
        damaged_chunks=scan.damaged,
        problem=scan.problem,
    )
    with replacing(out) as part, part.open("wb") as stream:
        _copy(scan, recovery, stream)
    return recovery


def _copy(scan: Scan, recovery: Recovery, stream: BinaryIO) -> None:
    writer = open_writer(stream)
    for record in scan.metadata:
        text = record.metadata.get("json", "")
        if record.name == SCENE_METADATA and not _is_valid(json_object, text, "the scene"):
            continue  # metadata has no checksum; a damaged scene must not cost the frames
        writer.add_metadata(record.name, record.metadata)
    if recovery.problem:
        writer.add_metadata(
            RECOVERY_METADATA, {"problem": recovery.problem, "frames": str(recovery.frames)}
        )
    for attachment in scan.attachments:
        writer.add_attachment(**vars(attachment))
    schemas = {0: 0}  # 0 stands for "no schema" in MCAP
    for key, schema in scan.schemas.items():
        schemas[key] = writer.register_schema(schema.name, schema.encoding, schema.data)
    channels = {
        key: writer.register_channel(
            c.topic, c.message_encoding, schemas.get(c.schema_id, 0), c.metadata
        )
        for key, c in scan.channels.items()
    }
    for message in scan.messages:
        channel = scan.channels.get(message.channel_id)
        if channel is None or (
            channel.topic == EVENTS_TOPIC and not _is_valid(parse_event, scan, message)
        ):
            continue  # its channel is damaged, or it is another record with a damaged channel
        writer.add_message(**{**vars(message), "channel_id": channels[message.channel_id]})
    writer.finish()  # type: ignore[no-untyped-call]


def _is_valid(parse: Callable[..., object], *arguments: Any) -> bool:
    try:
        parse(*arguments)
    except InputError:
        return False
    return True
