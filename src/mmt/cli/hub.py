"""``mmt hub``: a leader's shared model for any number of listeners."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import psutil

from mmt.cli.common import (
    ALL_ADDRESSES,
    OPTIONS,
    messages,
    output,
    require_one_output,
    stop_on_signals,
    summary_table,
    write_json,
    write_line,
)
from mmt.cli.visiting import own_address
from mmt.core.extras import require
from mmt.core.logs import Logs
from mmt.core.queued_output import queue_output
from mmt.scene.files import load_hub_scene
from mmt.scene.sharing_tables import HubScene, Sharing
from mmt.sharing.hub.descriptors import make_room

if TYPE_CHECKING:
    from mmt.sharing.hub.service import Hub

_SPACING_S: Final = 5.0
"""Time between two lines that say how many are listening."""


def run_hub(
    scene_file: Path | None,
    overrides: dict[str, Any],
    duration_s: float | None,
    json_file: Path | None,
    *,
    json_lines: bool,
) -> None:
    """Serve until Ctrl-C, or for so long; then print or write the summary.

    Raises
    ------
    InputError
        A key, a URL, a token or a certificate cannot be used.
    MmtError
        Redis or the leader does not answer, or the port cannot be used.
    """
    require("redis")
    require_one_output(json_file, json_lines=json_lines)
    scene = load_hub_scene(scene_file, overrides, OPTIONS)
    queue_output()
    with Logs("hub", None, None):
        summary = asyncio.run(_run(scene, duration_s, json_lines=json_lines))
    if json_lines:
        write_line("summary", **summary)
    else:
        output.print(summary_table("hub", summary))
    write_json(json_file, summary)


async def _run(scene: HubScene, duration_s: float | None, *, json_lines: bool) -> dict[str, Any]:
    from mmt.sharing.hub.service import Hub

    def say(sentence: str) -> None:
        if json_lines:
            write_line("event", event=sentence)
        else:
            messages.print(sentence, highlight=False)

    make_room(scene.sharing.most, say)
    ended = asyncio.Event()
    stop_on_signals(ended.set)
    hub = Hub(scene, lambda port: _address(scene.sharing, port), say)
    counting = asyncio.create_task(_count(hub, say))
    begun_s = time.monotonic()
    try:
        await hub.start()
        if json_lines:
            write_line("ready", port=hub.server.port, address=hub.address)
        else:
            messages.print(f"hub:      {hub.address}", highlight=False)
        if duration_s is not None:
            asyncio.get_running_loop().call_later(duration_s, ended.set)
        await hub.run(ended)
    finally:
        counting.cancel()
        await hub.stop()
    process = psutil.Process()
    cpu = process.cpu_times()
    return {
        "address": hub.address,
        "duration_s": round(time.monotonic() - begun_s, 3),
        "most_listeners": hub.most_listeners,
        "model": {"session_id": hub.copy.session_id, "number": hub.copy.number},
        "sent": {**hub.relay.sent, "listened_s": round(hub.server.listened_s, 3)},
        "process": {
            "cpu_s": round(cpu.user + cpu.system, 3),
            "memory_mb": round(process.memory_info().rss / 1e6, 1),
        },
    }


async def _count(hub: "Hub", say: Callable[[str], None]) -> None:
    """Say how many are listening, seldom."""
    said = 0
    while True:
        await asyncio.sleep(_SPACING_S)
        if hub.listeners != said:
            said = hub.listeners
            say(f"{said} listening")


def _address(settings: Sharing, port: int) -> str:
    """Return where listeners reach this machine."""
    host = own_address() if settings.host in ALL_ADDRESSES else settings.host
    return settings.model_copy(update={"host": host}).url(port)
