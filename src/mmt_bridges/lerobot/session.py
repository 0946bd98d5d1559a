"""The session that a robot and a teleoperator of LeRobot share: one process for both."""

import atexit
import json
import logging
import queue
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Literal

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.running.child_process import ChildProcess
from mmt.scene import Scene
from mmt.scene.files import find_scene
from mmt_bridges.lerobot.settings import Settings, session_scene

LOG: Final = logging.getLogger("mmt_bridges.lerobot")

_REPLY_S: Final = 2.0
_END_S: Final = 20.0
_ENDED: Final = "ended"


class SharedSession:
    """Run `mmt_bridges.lerobot.process` while a device uses it, and send it requests.

    Parameters
    ----------
    settings
        Settings of the session.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._scene: Scene | None = None
        self._users: set[object] = set()
        self._asking = threading.Lock()
        self._process: ChildProcess | None = None
        self._reading: threading.Thread | None = None
        self._lines: queue.Queue[dict[str, Any]] = queue.Queue()
        self._owed = 0  # answers that have not been taken
        self.given: list[float] | None = None
        """Last action of the teleoperator."""

    def change(self, settings: Settings) -> None:
        """Replace the settings; an `InputError` if they differ while the session runs."""
        if settings != self.settings:
            if self.running:
                raise InputError(
                    f"scene {settings.scene}: it runs already, with other settings; disconnect "
                    "what uses it first"
                )
            self.settings, self._scene = settings, None

    @property
    def scene(self) -> Scene:
        """The scene that the leader runs.

        Raises
        ------
        InputError
            The scene cannot be used.
        """
        if self._scene is None:
            self._scene = session_scene(self.settings)
        return self._scene

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    def acquire(self, user: object) -> None:
        """Add a user; the first one starts the session and waits until it is ready.

        Raises
        ------
        MmtError
            The session cannot begin; the message says why.
        """
        if not self.running:
            self._close()
            self._start()
        self._users.add(user)

    def release(self, user: object) -> None:
        """Remove a user; the last one ends the session."""
        self._users.discard(user)
        if not self._users:
            self._close()

    def ask(
        self, what: Literal["observe", "command", "follow"], action_mm: Vector | None = None
    ) -> list[float]:
        """Return the answer to a request; see the methods of `ObservingPart` for each.

        Parameters
        ----------
        what
            Name of the method.
        action_mm
            Position for the robot to follow.

        Raises
        ------
        DeviceLost
            The follower is lost, or the session has ended.
        """
        request = json.dumps({"ask": what, "mm": action_mm}).encode() + b"\n"
        with self._asking:
            process = self._process
            if process is None:
                raise DeviceLost("the session of mmt has ended")
            self._owed += 1
            with suppress(OSError):  # it has ended, and has written why
                process.stdin.write(request)
                process.stdin.flush()
            reply: dict[str, Any] = {}
            try:
                while self._owed and _ENDED not in reply:  # Ctrl-C leaves an answer behind
                    reply = self._lines.get(timeout=_REPLY_S)
                    self._owed -= 1
            except queue.Empty:
                process.kill()
                reply = {_ENDED: f"no answer within {_REPLY_S:g} s: the session is ended"}
                self._lines = queue.Queue()  # a late answer must not answer the next request
        if _ENDED in reply:
            self._lines.put(reply)  # for the next request
            raise DeviceLost(reply[_ENDED])
        if "error" in reply:
            raise DeviceLost(reply["error"])
        values: list[float] = reply["values"]
        return values

    # --- the process

    def _start(self) -> None:
        _ = self.scene  # raises if it cannot be used
        self.given, self._lines, self._owed = None, queue.Queue(), 0
        settings = json.dumps(asdict(self.settings))
        self._process = ChildProcess("-m", "mmt_bridges.lerobot.process", settings)
        atexit.register(self._close)  # LeRobot does not disconnect after each of its errors
        self._reading = threading.Thread(target=self._read, args=(self._process,), daemon=True)
        self._reading.start()
        wait_s = self.settings.wait_s
        begun: dict[str, Any] = {_ENDED: f"no frame of the follower has come within {wait_s:g} s"}
        try:
            with suppress(queue.Empty):
                begun = self._lines.get(timeout=wait_s)
        except BaseException:  # Ctrl-C
            self._close()
            raise
        if _ENDED in begun:
            self._close()
            raise MmtError(begun[_ENDED])

    def _read(self, process: ChildProcess) -> None:
        """Queue the answers of the process; log its events, and what drivers print."""
        lines, why = self._lines, "the process of mmt has ended unexpectedly"
        for raw in process.stdout:
            line = _parsed(raw)
            if "event" in line:
                LOG.info("%s", line["event"])
            elif _ENDED in line:
                why = line[_ENDED]
            else:
                lines.put(line)
        lines.put({_ENDED: why})

    def _close(self) -> None:
        atexit.unregister(self._close)
        process, reading = self._process, self._reading
        self._process = self._reading = None
        if process is None or reading is None:
            return
        process.end(_END_S)
        reading.join(_END_S)
        process.close()


def _parsed(raw: bytes) -> dict[str, Any]:
    try:
        line = json.loads(raw)
    except ValueError:
        line = None
    return line if isinstance(line, dict) else {"event": raw.decode(errors="replace").strip()}


_SESSIONS: Final[dict[Path, SharedSession]] = {}


def shared_session(scene: str, settings: Settings | None = None) -> SharedSession:
    """Return the session of a scene, which all devices in this process share.

    Parameters
    ----------
    scene
        A TOML file, or an example's name.
    settings
        Settings of the robot; None keeps those of the session.

    Raises
    ------
    InputError
        There is no such scene, or it runs with other settings.
    """
    file = find_scene(Path(scene)).resolve()
    session = _SESSIONS.setdefault(file, SharedSession(settings or Settings(scene)))
    if settings is not None:
        session.change(settings)
    return session
