"""The part that publishes frames, events and the model on topics of ROS 2.

A process with a node, `mmt_bridges.ros.process`, publishes them. Stamps are UTC.
"""

import asyncio
import json
import subprocess
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

import msgpack
import numpy as np

from mmt.core.errors import InputError, MmtError
from mmt.core.extras import require
from mmt.core.running.programs import python_command
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
            process.release()

    def _leave(self) -> None:
        self._end()
        if self._outlet is not None:
            self._outlet.end()

    def _push(self) -> None:
        super()._push()
        while self._models and self._outlet is not None:
            self._outlet.push_model(self._models.popleft().to_bytes())
            self._pushed["models"] += 1


class RosProcess:
    """The process that publishes; methods raise `MmtError` if the process has ended.

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
        self.process = subprocess.Popen(  # noqa: S603 - our own module
            python_command("-m", "mmt_bridges.ros.process"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=sys.platform != "win32",
        )
        assert self.process.stdin is not None  # noqa: S101 - it was asked for
        assert self.process.stdout is not None  # noqa: S101 - it was asked for
        self._input, self._output = self.process.stdin, self.process.stdout
        with suppress(OSError):  # it has ended already, and has written why
            self._send(settings)
        answer = self._read_line()
        if "problem" in answer:
            self.kill()
            self.release()
            raise InputError(f"[ros] cannot publish: {answer['problem']}")

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

    def end(self) -> None:
        """Close the process's input; wait until it has published all it has, and ended."""
        with suppress(OSError):  # it has ended by itself
            self._input.close()
        self.process.wait()

    def kill(self) -> None:
        """Kill the process, and wait until it has ended."""
        self.process.kill()
        self.process.wait()

    def release(self) -> None:
        """Close the pipes, after the process and the thread that wrote to it have ended."""
        for pipe in (self._input, self._output):
            with suppress(OSError):  # unsent bytes
                pipe.close()

    def _write(self, message: object) -> None:
        try:
            self._send(message)
        except OSError as error:
            raise MmtError(str(self._read_line()["problem"])) from error

    def _send(self, message: object) -> None:
        self._input.write(msgpack.packb(message))
        self._input.flush()

    def _read_line(self) -> dict[str, Any]:
        """Return the next line that the process writes, or a problem if it has ended without."""
        line = self._output.readline()
        return json.loads(line) if line else {"problem": "the process that publishes has ended"}
