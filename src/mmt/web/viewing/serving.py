"""Serve a recording's page until the person has seen enough."""

import asyncio
import errno
from collections.abc import Callable

from aiohttp import web

from mmt.core.errors import InputError
from mmt.web.viewing.recording import ViewedRecording
from mmt.web.viewing.site import HOST, PATH, recording_application


class RecordingServer:
    """A recording's page at a port of this machine.

    Parameters
    ----------
    recording
        What is shown; closed at the end.
    port
        Zero for any that is free.
    """

    def __init__(self, recording: ViewedRecording, port: int = 0) -> None:
        self._recording = recording
        self._port = port
        self._ended = asyncio.Event()

    def stop(self) -> None:
        """Let `run` end."""
        self._ended.set()

    async def run(self, ready: Callable[[str], None]) -> None:
        """Serve until `stop`; `ready` is called with the page's address.

        Raises
        ------
        InputError
            The port is taken, or not allowed.
        """
        runner = web.AppRunner(
            recording_application(self._recording), access_log=None, shutdown_timeout=1.0
        )
        await runner.setup()
        try:
            site = web.TCPSite(runner, HOST, self._port)
            try:
                await site.start()
            except OSError as error:
                raise InputError(_port_problem(self._port, error)) from error
            self._recording.start()
            ready(f"http://{HOST}:{runner.addresses[0][1]}{PATH}/")
            await self._ended.wait()
        finally:
            await runner.cleanup()
            await asyncio.to_thread(self._recording.close)


def _port_problem(port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"--port {port}: another program uses it; name another one, or none for any"
    return f"--port {port}: {error.strerror or error}"
