"""Describe what a session file holds."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.frames import FIELD_OF_CHANNEL, Channel
from mmt.core.printable import printable
from mmt.session.data import JsonObject, RecordedSession, duration_s, missing_frames
from mmt.session.files import read_session
from mmt.session.mcap_reader import scanned_session
from mmt.session.mcap_scan import scan_mcap
from mmt.session.operators import ControlPeriod, control_periods

if TYPE_CHECKING:
    from mmt.texture.signals.faults import SignalFaults

_FILTERED_AT_ONCE: Final = 60_000
"""Frames, a minute of them: memory is that of a minute however long the session is."""


@dataclass(frozen=True)
class SessionInfo:
    """A summary of a session file."""

    path: Path
    size_bytes: int
    duration_s: float
    frames: int
    missing_frames: int
    faults: "SignalFaults | None"
    """What of the signals was no measurement. None without position, force or acceleration, where
    the recorded scene is not valid, and where the numerics are not installed."""
    rate_hz: float | None
    """Frames a second by the recorded times, gaps counted as frames; None below two."""
    acceleration_rate_hz: float | None
    """Samples of acceleration a second, likewise; None without acceleration."""
    channels: tuple[Channel, ...]
    scene: str | None
    """The scene's name, None where the file holds no scene."""
    session_id: str | None
    """Names the session in the logs of both services, None where the file holds none."""
    truth: bool
    """Whether the follower attached annotations, such as the simulated truth."""
    models: int
    events: int
    control: tuple[ControlPeriod, ...]
    """Who moved the robot when, empty where control was never handed over."""
    hand_overs: tuple[str, ...]
    """What happened to the control of the robot, a sentence each with its session time."""
    outputs: int
    """Samples of the leader's output."""
    output_rate_hz: float | None
    """Its samples a second; None without output."""
    listeners: tuple[JsonObject, ...]
    """What is known of each that listened to the shared model, in the order in which they left;
    only its ``id`` and ``name`` where its leaving was not recorded."""
    complete: bool
    """False for a file that was cut off, recovered or not."""


def info(path: str | Path) -> SessionInfo:
    """Return what a session file of any readable format holds, a cut-off MCAP file included.

    Raises
    ------
    InputError
        The file is missing, of another format or not valid.
    """
    path = Path(path)
    is_mcap = path.suffix.lower() == ".mcap"
    session = scanned_session(scan_mcap(path)) if is_mcap else read_session(path)
    frames = session.frames
    rate_hz = _rate_hz(session)
    accelerates = "acceleration" in session.channels
    return SessionInfo(
        path=path,
        size_bytes=_size_bytes(path),
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


def _size_bytes(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _faults(session: RecordedSession) -> "SignalFaults | None":
    """Pass the frames through the filter of the modelling; about 1 us each."""
    if not set(FIELD_OF_CHANNEL) <= set(session.channels):
        return None
    from mmt.scene import Scene, Texture
    from mmt.scene.recorded import scene_of_recording

    try:
        for package in ("numba", "scipy"):
            require(package)
        scene = scene_of_recording(session.scene, "the scene") if session.scene else Scene()
    except InputError:
        return None
    from mmt.texture.signals.filtering import StreamFilter
    from mmt.texture.signals.numbering import StreamNumbering

    settings = (scene.texture or Texture()).settings(session.samples_per_frame)
    stream = StreamFilter(settings)
    frames = StreamNumbering().number(session.frames)
    for start in range(0, len(frames), _FILTERED_AT_ONCE):
        stream.process(frames[start : start + _FILTERED_AT_ONCE])
    return stream.faults


def _listeners(events: Iterable[JsonObject]) -> tuple[JsonObject, ...]:
    joined: dict[object, JsonObject] = {}
    left: dict[object, JsonObject] = {}
    for event in events:
        listener = event.get("listener")
        if not isinstance(listener, Mapping):
            continue
        where = left if event.get("kind") == "listener left" else joined
        where[listener.get("id")] = dict(listener)
    return (*left.values(), *(each for key, each in joined.items() if key not in left))


def _hand_overs(session: RecordedSession) -> Iterator[str]:
    for event in session.events:
        time_s, sentence = event.get("time_s"), event.get("event")
        if "control" in event and isinstance(time_s, int | float):
            yield f"{time_s:.3f} s: {printable(str(sentence))}"


def _rate_hz(session: RecordedSession) -> float | None:
    frames = session.frames
    if len(frames) < 2:
        return None
    span_ns = int(frames["time_ns"][-1]) - int(frames["time_ns"][0])
    steps = int(frames["sequence"][-1]) - int(frames["sequence"][0])
    return steps * 1e9 / span_ns if span_ns > 0 else None


def _scene_name(session: RecordedSession) -> str | None:
    if session.scene is None:
        return None
    table = session.scene.get("session", {})
    name = table.get("name") if isinstance(table, dict) else None
    return None if name is None else str(name)
