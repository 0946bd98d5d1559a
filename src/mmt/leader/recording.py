"""The part that records: the scene's own recording, and those that a person starts."""

import asyncio
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError, MmtError
from mmt.leader.part import Part, Session

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.link.protocol import FollowerHello
    from mmt.session.recorder import Existing, McapRecorder

_HEAD: Final = ("gain", "frozen", "control")
"""Keys of events that hold on: a recording that starts later repeats the newest with each."""


class RecordingPart(Part):
    """Record frames, the output, events and models, while a recording runs.

    If a recording fails, as on a full disk, the user is told; the session goes on without it.

    Parameters
    ----------
    session
        Session whose scene says what is recorded, and whether from the start.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.recorder: McapRecorder | None = None
        """Recorder that runs or has failed, or None."""
        self._ended: McapRecorder | None = None
        self._failed: list[McapRecorder] = []
        self._annotations = b""
        self._head: dict[str, dict[str, Any]] = {}
        self.before_end: Callable[[], None] = lambda: None
        """Called before `end` closes the recording."""

    @property
    def running(self) -> "McapRecorder | None":
        """Recorder that runs and has not failed, or None."""
        return None if self.recorder is None or self.recorder.error else self.recorder

    def begin(self) -> None:
        """Make the file of the scene's recording.

        Raises
        ------
        InputError
            The file cannot be made.
        """
        table = self._session.scene.recording
        if table is not None:
            self.recorder = self._made(table.file, table.existing)
            if self.recorder.path != table.file:
                self._session.journal.event(f"recording into {self.recorder.path}")

    async def start(self, path: Path) -> None:
        """Start a recording into a new file.

        Raises
        ------
        InputError
            A recording runs already, or the file cannot be made.
        MmtError
            The session has ended meanwhile.
        """
        if self.running is not None:
            raise InputError("a recording runs already")
        self.poll()
        recorder = await asyncio.to_thread(self._made, path, "refuse")
        if self._session.ending.reached:
            await asyncio.to_thread(recorder.close)
            raise MmtError("the session has ended")
        self.recorder = recorder
        self._annotate()
        for event in self._head.values():
            recorder.record_event(event | {"time_s": self._session.journal.time_s})
        self._session.journal.event(f"recording into {path}")

    async def end(self) -> "McapRecorder":
        """End the recording that runs, and return it.

        Raises
        ------
        InputError
            No recording runs.
        MmtError
            The recording could not be written to its end.
        """
        recorder = self.running
        if recorder is None:
            raise InputError("no recording runs")
        self.before_end()
        self._session.journal.event(f"recording of {recorder.path} ended")
        self.recorder, self._ended = None, recorder
        await asyncio.to_thread(recorder.close)
        if recorder.error is not None:
            self._failed.append(recorder)
            raise MmtError(_failure(recorder))
        return recorder

    def close(self) -> None:
        """Finish the file."""
        if self.recorder is not None:
            self.recorder.close()

    # --- recorded data

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Record frames (n,)."""
        if self.recorder is not None:
            self.recorder.record_frames(frames)

    def on_backfill(self, frames: RecordArray, arrival_ns: int) -> None:
        """Record back-filled frames (n,) at their place."""
        if self.recorder is not None:
            self.recorder.record_backfill(frames, arrival_ns)

    def on_output(self, first_ns: int, mode: str, vibration_m_s2: FloatArray) -> None:
        """Record the played vibration (n,)."""
        if self.recorder is not None:
            self.recorder.record_output(first_ns, mode, vibration_m_s2)

    def on_event(self, event: dict[str, Any], _sentence: str | None) -> None:
        """Record an event."""
        self._head |= {key: event for key in _HEAD if key in event}
        if self.recorder is not None:
            self.recorder.record_event(event)

    def on_follower(self, hello: "FollowerHello") -> None:
        """Keep the follower's annotations, also for a recording that starts later."""
        self._annotations = hello.annotations
        self._annotate()

    def _annotate(self) -> None:
        if self.recorder is not None and self._annotations:
            self.recorder.attach_annotations(self._annotations)

    # --- reports

    def poll(self) -> None:
        """Report once that the recording has failed, for instance on a full disk."""
        recorder = self.recorder
        if recorder is None or recorder.error is None or recorder in self._failed:
            return
        self._failed.append(recorder)
        self._session.journal.event(
            f"{_failure(recorder)}: the session goes on without it", frames=recorder.frames
        )

    def faults(self) -> list[str]:
        """Return why recordings have failed."""
        return [_failure(recorder) for recorder in self._failed]

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return file and counts of a recording: the first that failed, or else the newest."""
        recorder = next(iter(self._failed), None) or self.recorder or self._ended
        if recorder is None:
            return {}
        table = {
            "file": str(recorder.path),
            "frames": recorder.frames,
            "dropped": recorder.dropped,
            "error": str(recorder.error) if recorder.error is not None else None,
        }
        return {"recording": table}

    def metrics(self) -> "Iterable[Metric]":
        """Return the counts of the recording."""
        recorder = self.recorder
        if recorder is None:
            return
        from mmt.core.output.exposition import counter

        yield counter("recorded_frames", "Frames in the recording.", recorder.frames)
        yield counter("recording_dropped_frames", "Frames that found no room.", recorder.dropped)

    def _made(self, path: Path, existing: "Existing") -> "McapRecorder":
        from mmt.session.recorder import McapRecorder

        scene = self._session.scene
        return McapRecorder(
            path,
            channels=scene.channels(),
            scene=scene.dump(),
            session_id=self._session.log.session_id,
            existing=existing,
            scalars=scene.recording is not None and scene.recording.scalars,
            samples_per_frame=self._session.samples_per_frame,
            session_time_s=self._session.time_s,
        )


def _failure(recorder: "McapRecorder") -> str:
    return f"recording {recorder.path}: {recorder.error}"
