"""The process beside LeRobot that runs the leader and, if wanted, the follower.

``python -m mmt_bridges.lerobot.process SETTINGS`` takes `Settings` as JSON. Standard input takes
requests as JSON lines: ``{"ask": "follow", "mm": [x, y, z]}``, or "observe" or "command" with null.
Each is answered by one line on standard output, ``{"values": [...]}`` or ``{"error": "why"}``. The
process writes ``{"ready": true}`` before the answers, ``{"event": "..."}`` at any time, and
``{"ended": "why"}`` last. The session ends when standard input is closed.
"""

import asyncio
import json
import os
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from mmt.core.errors import FAILED, MmtError
from mmt.core.output.streams import finish_output, queue_output
from mmt_bridges.lerobot.settings import Settings, session_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from mmt.leader.service import Leader
    from mmt.scene import Scene
    from mmt_bridges.lerobot.observing import ObservingPart

_LAST_S: Final = 5.0


def write(**line: Any) -> None:
    """Write a line for LeRobot, which may have ended."""
    sys.stdout.write(json.dumps(line) + "\n")


def _event(sentence: str) -> None:
    write(event=sentence)


def run(settings: Settings) -> str:
    """Run the session to its end, and return its outcome.

    Raises
    ------
    MmtError
        The session cannot begin, or has failed.
    """
    from mmt.core.extras import optional_import
    from mmt.core.kernel_cache import compile_kernels
    from mmt.core.output.logs import Logs
    from mmt.leader.parts import numerics_of

    scene = session_scene(settings)
    if numerics := numerics_of(scene):
        compile_kernels(numerics, _event)
    with Logs("leader", None, None), optional_import():
        return asyncio.run(_run(settings, scene))


async def _run(settings: Settings, scene: "Scene") -> str:
    from mmt.cli.common import stop_on_signals
    from mmt.leader.service import Leader
    from mmt_bridges.lerobot.observing import ObservingPart

    leader = Leader(scene, on_event=_event)
    ready = asyncio.Event()
    hand = leader.parts.hand
    assert hand is not None  # noqa: S101 - the settings give every scene one
    part = ObservingPart(leader.session, hand, ready)
    leader.parts.add(part)
    stop_on_signals(leader.stop)
    tasks: list[asyncio.Task[None]] = []
    requests = asyncio.create_task(_answer(leader, part, ready))

    def listening() -> None:
        if settings.follower:
            tasks.append(asyncio.create_task(_follow(settings, scene, leader)))
        else:
            _event(f"waiting for a follower at port {leader.port}")

    try:
        summary = await leader.run(listening)
    finally:
        requests.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=_LAST_S)
        for task in tasks:
            task.cancel()
        await asyncio.gather(requests, *tasks, return_exceptions=True)
    if summary.problem is not None:
        raise MmtError(summary.problem.removeprefix(FAILED))
    return summary.outcome


async def _follow(settings: Settings, scene: "Scene", leader: "Leader") -> None:
    """Run the follower as a process of its own; the session ends with it."""
    from mmt.cli.running.child import Child

    assert scene.link is not None and leader.port is not None  # noqa: S101, PT018
    url = scene.link.url(leader.port)
    arguments = ["follower", settings.scene, "--leader", url, "--json-lines"]
    child = await Child.start("follower", "mmt.cli.running.child", arguments, on_warning=_event)
    try:
        async for line in child.lines():
            if line["kind"] == "event":
                _event(f"follower: {line['event']}")
        code = await child.wait()
        if code != 0:
            why = child.messages.removeprefix("error: ") or f"it ended with exit code {code}"
            leader.ending.fail(MmtError(f"the follower: {why}"))
    finally:
        await child.kill()


async def _answer(leader: "Leader", part: "ObservingPart", ready: asyncio.Event) -> None:
    """Tell LeRobot when it may send requests, and answer them until the input ends."""
    lines: asyncio.Queue[bytes] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def put(line: bytes) -> None:
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(lines.put_nowait, line)

    threading.Thread(target=_read, args=(put,), name="requests", daemon=True).start()
    ended = asyncio.create_task(lines.get())  # before `ready` only the end can come
    waiting = asyncio.create_task(ready.wait())
    try:
        await asyncio.wait([ended, waiting], return_when=asyncio.FIRST_COMPLETED)
        if waiting.done():
            write(ready=True)
        while line := await ended:
            write(**_reply(part, json.loads(line)))
            ended = asyncio.create_task(lines.get())
        leader.stop()
    except Exception as error:  # noqa: BLE001 - LeRobot would wait for an answer in vain
        leader.ending.fail(error)
    finally:
        ended.cancel()
        waiting.cancel()


def _reply(part: "ObservingPart", request: dict[str, Any]) -> dict[str, Any]:
    try:
        given = () if request["mm"] is None else (tuple(request["mm"]),)
        return {"values": getattr(part, request["ask"])(*given)}
    except MmtError as error:
        return {"error": str(error)}


def _read(put: "Callable[[bytes], None]") -> None:
    """Read lines from standard input; an empty one is its end."""
    rest = b""
    while part := os.read(0, 65_536):
        *lines, rest = (rest + part).split(b"\n")
        for line in lines:
            put(line)
    put(b"")


def main() -> None:
    """Run the session of the settings in the first argument."""
    queue_output()
    try:
        ended = run(Settings(**json.loads(sys.argv[1])))
    except MmtError as error:
        ended = str(error)
    write(ended=ended)
    finish_output()


if __name__ == "__main__":
    main()
