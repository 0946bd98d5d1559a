"""``mmt hub``: a leader's shared model for any number of listeners."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import psutil
import typer

from mmt.cli.common import (
    json_option,
    messages,
    output,
    require_one_output,
    stop_on_signals,
    summary_table,
    write_json,
    write_line,
)
from mmt.core.extras import require
from mmt.core.output.logs import Logs
from mmt.core.output.streams import queue_output
from mmt.link.serving.accepting import descriptors
from mmt_share.commands.visitors_page import reachable_url
from mmt_share.hub.scene import HubScene, load_hub_scene

if TYPE_CHECKING:
    from mmt_share.hub.service import Hub

_OPTIONS: Final = {
    "hub.redis": "--redis",
    "hub.address": "--address",
    "listening.url": "URL",
    "sharing.port": "--port",
}
_SPACING_S: Final = 5.0
"""Time between two lines that say how many are listening."""
_FILES: Final = 8
"""Files per listener: a server admits two connections for each listener, and uses a quarter of its
files for them; see `mmt.link.serving.accepting.Acceptor`."""


def hub(
    url: Annotated[str, typer.Argument(help="Where the leader shares its model.")],
    scene_file: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENE]", help="Tables hub, sharing, listening: a TOML file."),
    ] = None,
    redis: Annotated[
        str | None, typer.Option(metavar="URL", help="The Redis server that joins the hubs.")
    ] = None,
    address: Annotated[
        str | None, typer.Option(metavar="URL", help="Where listeners reach this hub.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="Listen on this port; 0 takes any free one.")
    ] = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="Seconds to serve.")] = None,
    json_file: Annotated[Path | None, json_option("Write the summary.")] = None,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Progress and summary as JSON lines on stdout.")
    ] = False,
) -> None:
    """Serve a leader's shared model to any number of listeners, together with other hubs."""
    require("redis")
    require_one_output(json_file, json_lines=json_lines)
    overrides = {
        "listening.url": url,
        "hub.redis": redis,
        "hub.address": address,
        "sharing.port": port,
    }
    scene = load_hub_scene(scene_file, overrides, _OPTIONS)
    queue_output()
    with Logs("hub", None, None):
        summary = asyncio.run(_run(scene, duration, json_lines=json_lines))
    if json_lines:
        write_line("summary", **summary)
    else:
        output.print(summary_table("hub", summary))
    write_json(json_file, summary)


async def _run(scene: HubScene, duration_s: float | None, *, json_lines: bool) -> dict[str, Any]:
    from mmt_share.hub.service import Hub

    def say(sentence: str) -> None:
        if json_lines:
            write_line("event", event=sentence)
        else:
            messages.print(sentence)

    make_room(scene.sharing.most, say)
    ended = asyncio.Event()
    stop_on_signals(ended.set)
    serving = Hub(scene, lambda port: reachable_url(scene.sharing, port), say)
    counting = asyncio.create_task(_count(serving, say))
    begun_s = time.monotonic()
    try:
        await serving.start()
        if json_lines:
            write_line("ready", port=serving.server.port, address=serving.address)
        else:
            messages.print(f"hub:      {serving.address}")
        if duration_s is not None:
            asyncio.get_running_loop().call_later(duration_s, ended.set)
        await serving.run(ended)
    finally:
        counting.cancel()
        await serving.stop()
    process = psutil.Process()
    cpu = process.cpu_times()
    return {
        "address": serving.address,
        "duration_s": round(time.monotonic() - begun_s, 3),
        "most_listeners": serving.most_listeners,
        "model": {"session_id": serving.copy.session_id, "number": serving.copy.number},
        "sent": {**serving.relay.sent, "listened_s": round(serving.server.listened_s, 3)},
        "process": {
            "cpu_s": round(cpu.user + cpu.system, 3),
            "memory_mb": round(process.memory_info().rss / 1e6, 1),
        },
    }


async def _count(hub: "Hub", say: Callable[[str], None]) -> None:
    """Report the number of listeners if it has changed, at most every 5 s."""
    reported = 0
    while True:
        await asyncio.sleep(_SPACING_S)
        if hub.listeners != reported:
            reported = hub.listeners
            say(f"{reported} listening")


def make_room(listeners: int, say: Callable[[str], None]) -> None:
    """Raise this process's limit of open files as far as possible, and say if it is too low.

    Parameters
    ----------
    listeners
        Number of listeners to serve at once.
    say
        Called with a sentence if the limit is too low.
    """
    try:
        import resource
    except ImportError:
        return  # Windows has no such limit
    needed = _FILES * listeners
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    raised = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))
    if descriptors() < needed:
        say(
            f"{raised} files may be open, which is room for {raised // _FILES} listeners and not "
            f"for {listeners}: raise the limit before the start (`ulimit -n {needed}`)"
        )
