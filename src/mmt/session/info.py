"""Summarize a session file."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.core.errors import InputError, printable
from mmt.core.extras import require
from mmt.core.files.existing import size_bytes
from mmt.core.frames import CHANNELS, Channel
from mmt.session.data import JsonObject, RecordedSession, duration_s, missing_frames
from mmt.session.files import read_session
from mmt.session.mcap.reader import scanned_session
from mmt.session.mcap.scan import scan_mcap
from mmt.session.operators import ControlPeriod, control_periods

if TYPE_CHECKING:
    from mmt.texture.signals.aligned import SignalFaults

_FILTERED_AT_ONCE: Final = 60_000
"""Frames per call of the filter, one minute: bounds memory for long sessions."""


@dataclass(frozen=True)
class SessionInfo:
    """A summary of a session file."""

    path: Path
    size_bytes: int
    duration_s: float
    frames: int
    missing_frames: int
    faults: "SignalFaults | None"
    """Invalid samples in the signals. None if one of position, force and acceleration is missing,
    the recorded scene is not valid, or the numerics are not installed."""
    rate_hz: float | None
    """Frame rate by the recorded times, counting missing frames; None for less than two frames."""
    acceleration_rate_hz: float | None
    """Rate of acceleration, computed likewise; None without acceleration."""
    channels: tuple[Channel, ...]
    scene: str | None
    """The scene's name, or None if the file holds no scene."""
    session_id: str | None
    """Identifies the session in the logs of both services; None if the file holds no id."""
    truth: bool
    """Whether the follower attached annotations, such as the simulated truth."""
    models: int
    events: int
    control: tuple[ControlPeriod, ...]
    """Periods with the operator in control of the robot; empty if control never changed hands."""
    hand_overs: tuple[str, ...]
    """Events that concern control of the robot: session time and a sentence each."""
    outputs: int
    """Samples of the leader's output."""
    output_rate_hz: float | None
    """Sample rate of the output (Hz); None without output."""
    listeners: tuple[JsonObject, ...]
    """Listeners to the shared model, in the order in which they left, then those whose departure
    was not recorded, with only ``id`` and ``name``."""
    complete: bool
    """False if the file was cut off, also if it was then recovered."""


def info(path: str | Path) -> SessionInfo:
    """Summarize a session file of any readable format; an MCAP file may be cut off.

    Raises
    ------
    InputError
        The file is missing, of an unknown format or not valid.
    """
    path = Path(path)
    is_mcap = path.suffix.lower() == ".mcap"
    session = scanned_session(scan_mcap(path)) if is_mcap else read_session(path)
    frames = session.frames
    rate_hz = _rate_hz(session)
    accelerates = "acceleration" in session.channels
    return SessionInfo(
        path=path,
        size_bytes=size_bytes(path),
        duration_s=duration_s(frames),
        frames=len(frames),
        missing_frames=missing_frames(frames),
        faults=_faults(session),
        rate_hz=rate_hz,
        acceleration_rate_hz=session.samples_per_frame * rate_hz
        if rate_hz and accelerates
        else None,
        channels=session.channels,
        scene=_scene_name(session),
        session_id=session.session_id,
        truth=bool(session.annotations),
        models=len(session.models),
        events=len(session.events),
        control=control_periods(session.events, duration_s(frames)),
        hand_overs=tuple(_hand_overs(session)),
        outputs=sum(len(output.vibration_m_s2) for output in session.outputs),
        output_rate_hz=session.outputs[0].rate_hz if session.outputs else None,
        listeners=_listeners(session.events),
        complete=session.complete,
    )


def _faults(session: RecordedSession) -> "SignalFaults | None":
    """Count faults with the filter of the modelling, about 1 us per frame."""
    if not set(CHANNELS) <= set(session.channels):
        return None
    from mmt.scene import Scene, Texture
    from mmt.scene.files import scene_of_recording

    try:
        for package in ("numba", "scipy"):
            require(package)
        scene = scene_of_recording(session.scene, "the scene") if session.scene else Scene()
    except InputError:
        return None
    from mmt.texture.signals.filtering import StreamFilter, StreamNumbering

    settings = (scene.texture or Texture()).settings(session.samples_per_frame)
    stream = StreamFilter(settings)
    frames = StreamNumbering().number(session.frames)
    for start in range(0, len(frames), _FILTERED_AT_ONCE):
        stream.process(frames[start : start + _FILTERED_AT_ONCE])
    return stream.faults


def _listeners(events: Iterable[JsonObject]) -> tuple[JsonObject, ...]:
    joined: dict[str, JsonObject] = {}
    left: dict[str, JsonObject] = {}
    for event in events:
        listener = event.get("listener")
        if not isinstance(listener, Mapping):
            continue
        where = left if event.get("kind") == "listener left" else joined
        where[str(listener.get("id"))] = dict(listener)
    return (*left.values(), *(each for key, each in joined.items() if key not in left))


def _hand_overs(session: RecordedSession) -> Iterator[str]:
    for event in session.events:
        time_s, sentence = event.get("time_s"), event.get("event")
        if "control" in event and isinstance(time_s, int | float):
            yield f"{time_s:.3f} s: {printable(str(sentence))}"


def _rate_hz(session: RecordedSession) -> float | None:
    fields = (session.frames[name].astype(np.int64) for name in ("sequence", "time_ns"))
    steps, spans_ns = map(np.diff, fields)
    on = (steps > 0) & (spans_ns >= 0)  # not where the follower restarted
    return float(steps[on].sum() * 1e9 / spans_ns[on].sum()) if spans_ns[on].any() else None


def _scene_name(session: RecordedSession) -> str | None:
    table = (session.scene or {}).get("session")
    name = table.get("name") if isinstance(table, dict) else None
    return None if name is None else str(name)
