"""Export a session as a ROS 2 bag: a folder with an MCAP file of standard messages."""

import heapq
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.existing import replacing_folder
from mmt.session.data import FRAME_PERIOD_NS, RecordedSession, event_time_s, to_json
from mmt_bridges.ros.messages import SCENE, Message, Messages

_BAG_SUFFIXES: Final = {".yaml", ".mcap", ".db3"}
_METADATA_VERSION: Final = 8
_FRAMES_PER_BLOCK: Final = 4096
_LATEST_NS: Final = (1 << 31) * 1_000_000_000
"""The end of ROS 2's stamps, in 2038."""


def write_bag(path: Path, session: RecordedSession) -> None:
    """Write frames, scene and events; an existing bag of this name is replaced.

    Stamps are UTC: the beginning of the session plus the follower's time. If the session does not
    know its beginning, the present time is used.

    Raises
    ------
    InputError
        rosbags is not installed, the session's date is out of the range of ROS 2's stamps, the
        folder exists and holds something else than a bag, or see
        `mmt.session.files.export_session`.
    MmtError
        Writing failed.
    """
    require("rosbags")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    _require_replaceable(path)
    if not 0 <= (session.began_utc_ns or 0) < _LATEST_NS:
        raise InputError(f"cannot write {path}: ROS 2 has no stamps before 1970 and after 2037")
    with replacing_folder(path) as folder:
        writer = Writer(folder, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for stamp_ns, topic, message in _messages(session, Messages(store.types)):
                if topic.name not in connections:
                    connections[topic.name] = writer.add_connection(
                        topic.name, topic.kind, typestore=store
                    )
                data = store.serialize_cdr(message, topic.kind)
                writer.write(connections[topic.name], stamp_ns, data)


def _messages(session: RecordedSession, messages: Messages) -> Iterator[Message]:
    """Yield the session's messages by time."""
    began_ns = time.time_ns() if session.began_utc_ns is None else session.began_utc_ns
    if session.scene is not None:
        yield began_ns, SCENE, messages.text(to_json(dict(session.scene)))
    yield from heapq.merge(
        _frames(session, messages, began_ns),
        chain.from_iterable(
            messages.event(began_ns + round(event_time_s(event) * 1e9), event)
            for event in session.events
        ),
        key=lambda written: written[0],
    )


def _frames(session: RecordedSession, messages: Messages, began_ns: int) -> Iterator[Message]:
    """Yield the messages of the frames, made in blocks: Python numbers take ten times the room.

    Where their time falls, as of a follower's machine that restarted, it goes on by their numbers.
    """
    frames = session.frames
    steps_ns = np.diff(frames["time_ns"])
    if (falls := steps_ns < 0).any():
        frames = frames.copy()
        due_ns = np.maximum(1, np.diff(frames["sequence"].astype(np.int64))) * FRAME_PERIOD_NS
        frames["time_ns"][1:] += np.cumsum(np.where(falls, due_ns - steps_ns, 0))
    since_ns = began_ns - int(frames["time_ns"][0]) if len(frames) else 0
    for first in range(0, len(frames), _FRAMES_PER_BLOCK):
        block = frames[first : first + _FRAMES_PER_BLOCK]
        yield from messages.frames(block, session.channels, since_ns)


def _require_replaceable(path: Path) -> None:
    """Raise `InputError` if the path exists, unless it is a bag and nothing else."""
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"cannot write {path}: a ROS 2 bag is a folder, and this is a file")
    files = list(path.iterdir())
    is_bag = any(file.name == "metadata.yaml" for file in files)
    if not is_bag or any(file.is_dir() or file.suffix not in _BAG_SUFFIXES for file in files):
        raise InputError(
            f"cannot write {path}: this folder holds other things than a ROS 2 bag; choose "
            "another name"
        )
