"""The part that publishes frames, events and the model on topics of ROS 2.

A process with a node, `mmt_bridges.ros.process`, publishes them. Stamps are UTC.
"""

import asyncio
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.errors import InputError, MmtError
from mmt.core.extras import require
from mmt.core.running.child_process import ChildProcess
from mmt.leader.part import Session
from mmt.leader.publishing import Block, Marker, PublishingPart
from mmt.session.data import to_json
from mmt_bridges.tables import Ros

if TYPE_CHECKING:
    from mmt.leader.building import LeaderParts
    from mmt.leader.output.model_output import ModelOutput
    from mmt.texture.model.texture_model import TextureModel

_LEAVE_S: Final = 3.0
"""How long it may take to pass on queued messages at the end."""


class RosPart(PublishingPart["RosProcess"]):
    """Pass frames, events and the model on to the process that publishes them.

    Parameters
    ----------
    session
        Session of the run.
    table
        The scene's ``[ros]``.
    completing
        Provides the model.
    """

    table = "ros"
    compared = ("UTC compared", "utc_ahead_ns")

    def __init__(self, session: Session, table: Ros, completing: "ModelOutput") -> None:
        super().__init__(session, table.chunk_ms)
        self._namespace = table.namespace
        self._completing = completing
        self._model: TextureModel | None = None
        self._models: deque[TextureModel] = deque(maxlen=1)
        self._pushed["models"] = 0

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "RosPart | None":
        """Return the part, or None if the scene has no ``[ros]``.

        Raises
        ------
        InputError
            rclpy or rosbags cannot be imported.
        """
        table = session.scene.table(Ros)
        if table is None:
            return None
        if find_spec("rclpy") is None:
            raise InputError(
                "[ros] needs rclpy, which comes with ROS 2: source the setup.bash of its "
                f"installation before, for this version of Python ({sys.version_info.major}."
                f"{sys.version_info.minor})"
            )
        require("rosbags")
        return cls(session, table, parts.completing)

    def connect(self) -> None:
        """Start the process, which creates the topics.

        Raises
        ------
        InputError
            The process cannot create them, for example because of an invalid domain.
        """
        scene = self._session.scene
        self._outlet = RosProcess(
            {
                "namespace": self._namespace,
                "channels": scene.channels(),
                "scene": to_json(scene.dump()),
                "samples_per_frame": self._session.samples_per_frame,
            }
        )

    def clock_s(self) -> float:
        """Return the UTC of this machine."""
        return time.time()

    def poll(self) -> None:
        """Queue the model if it is new; report once if the process has failed."""
        super().poll()
        newest = self._completing.newest
        if newest is not None and newest is not self._model:
            self._model = newest
            self._models.append(newest)

    async def stop(self) -> None:
        """Pass on what is queued, for at most `_LEAVE_S`."""
        self.poll()
        process = self._outlet
        ending = asyncio.create_task(asyncio.to_thread(self._leave))
        done, _ = await asyncio.wait([ending], timeout=_LEAVE_S)
        if process is not None and not done:
            process.kill()
        await ending

    def close(self) -> None:
        """End the process."""
        process = self._outlet
        if process is not None:
            process.kill()
        super().close()
        if process is not None:
            process.close()

    def _leave(self) -> None:
        self._end()
        if self._outlet is not None:
            self._outlet.end(None)

    def _push(self) -> None:
        super()._push()
        while self._models and self._outlet is not None:
            self._outlet.push_model(self._models.popleft().to_bytes())
            self._pushed["models"] += 1


class RosProcess(ChildProcess):
    """The process that publishes; methods that push raise `MmtError` if the process has ended.

    Parameters
    ----------
    settings
        Arguments of `mmt_bridges.ros.process.Publisher`.

    Raises
    ------
    InputError
        The process cannot create the topics.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        super().__init__("-m", "mmt_bridges.ros.process")
        with suppress(OSError):  # it has ended already, and has written why
            self.send(settings)
        problem = self._problem()
        if problem is not None:
            self.close()
            raise InputError(f"[ros] cannot publish: {problem}")

    def push_frames(self, blocks: Sequence[Block]) -> None:
        """Push blocks of frames, with their times converted to UTC."""
        frames = np.concatenate([block.frames for block in blocks])
        ahead_ns = [block.ahead_ns for block in blocks]
        frames["time_ns"] += np.repeat(ahead_ns, [len(block.frames) for block in blocks])
        self._write({"frames": frames.tobytes()})

    def push_marker(self, marker: Marker) -> None:
        """Push an event."""
        self._write({"event": marker})

    def push_model(self, model: bytes) -> None:
        """Push a model's file."""
        self._write({"model": model})

    def _write(self, message: object) -> None:
        try:
            self.send(message)
        except OSError as error:
            raise MmtError(str(self._problem())) from error

    def _problem(self) -> Any:
        """Return what the process says next: its problem, or None once the topics exist."""
        try:
            return self.receive()
        except EOFError:
            return "the process that publishes has ended"
