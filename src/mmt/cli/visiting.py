"""The page of a demo that is shared: an address, and its QR code, for whoever comes by.

It is `mmt play --from URL` as a process, open to the network that this machine is in: visitors feel
the surface, and can move nothing.
"""

import asyncio
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from io import StringIO
from typing import IO, Final

_LONGEST_S: Final = 30.0
_POLL_S: Final = 0.1
_PORT: Final = 8770
_ELSEWHERE: Final = ("192.0.2.1", 9)  # an address that nobody has (RFC 5737); nothing is sent


class VisitorsPage:
    """Serve the page from the moment that there is a model, until `close`."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `close`
        self.address: str | None = None
        """Where visitors find it, None until it can be had."""

    async def open(self, url: str) -> str:
        """Serve what is shared at a URL; return a text for the terminal as soon as it can be had.

        The text is a sentence and, where `segno` is installed, a QR code; or says that it failed.
        """
        port = _free_port()
        self._process = subprocess.Popen(  # noqa: S603 - our own program; returns at once
            [
                *(sys.executable, "-m", "mmt.cli.entry", "main", "play", "--from", url),
                *("--host", "0.0.0.0", "--port", str(port), "--open"),  # noqa: S104 - it is asked for
            ],
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
            start_new_session=sys.platform != "win32",
        )
        while self._process.poll() is None:
            with suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.close()
                self.address = f"http://{own_address()}:{port}/player/"
                return f"feel it at {self.address}{qr_code(self.address)}"
            await asyncio.sleep(_POLL_S)
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip().rpartition("\n")[2]
        return f"no page for visitors: {said or 'its process has ended'}"

    def wait(self) -> None:
        """Wait for Ctrl-C, or for the page's end."""
        if self._process is not None:
            with suppress(KeyboardInterrupt):
                self._process.wait()

    def close(self) -> None:
        """End it."""
        self._errors.close()
        process, self._process = self._process, None
        if process is None:
            return
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def own_address() -> str:
    """Return this machine's address in the network that it is in, or its name."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as connection:
        try:
            connection.connect(_ELSEWHERE)
        except OSError:
            return socket.gethostname()
        return str(connection.getsockname()[0])


def qr_code(text: str) -> str:
    """Return lines that show a text as a QR code, none where `segno` is not installed."""
    try:
        import segno
    except ImportError:
        return ""
    lines = StringIO()
    segno.make(text).terminal(out=lines, compact=True, border=2)
    return f"\n{lines.getvalue().rstrip()}"


def _free_port() -> int:
    """Return the usual port, or any free one where it is taken."""
    for port in (_PORT, 0):
        with socket.socket() as connection, suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            connection.bind(("", port))
            return int(connection.getsockname()[1])
    return _PORT
