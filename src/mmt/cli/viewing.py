"""``mmt session view``: a recording on the monitor's page."""

import asyncio
from pathlib import Path

from mmt.cli.browsing import open_page
from mmt.cli.common import messages, output, stop_on_signals
from mmt.core.kernel_cache import kernels_are_compiled


def view_file(path: Path, *, port: int, show: bool) -> None:
    """Serve a recording's page until Ctrl-C; `show` opens it in the browser."""
    if not kernels_are_compiled():
        messages.print("compiling the numerics, at the first start only (15 to 60 s)")
    from mmt.web.viewing.recording import ViewedRecording
    from mmt.web.viewing.server import RecordingServer

    recording = ViewedRecording.open(path)
    if recording.windows.in_memory:
        messages.print(f"{path} has no index: all of it is held in memory", highlight=False)

    def ready(url: str) -> None:
        output.print(f"{path.name}: {url}", highlight=False)
        messages.print("Ctrl-C ends it", highlight=False)
        if show and not open_page(url):
            messages.print("no browser was found: open the address in one", highlight=False)

    async def serve() -> None:
        server = RecordingServer(recording, port)
        stop_on_signals(server.stop)
        await server.run(ready)

    asyncio.run(serve())
