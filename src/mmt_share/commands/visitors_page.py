"""The page of a shared model for visitors: its process, its address and a QR code.

The process is `mmt play --from URL`, open to this machine's network: visitors feel the surface, but
cannot move the robot. The process ends when its standard input is closed, and so also if the
program that started it is killed.
"""

import asyncio
import os
import socket
import subprocess
import time
from collections.abc import Coroutine
from contextlib import suppress
from io import StringIO
from typing import Any, Final

from mmt.core.errors import InputError
from mmt.core.running.child_process import ChildProcess
from mmt.link.access import Access
from mmt.scene import Scene
from mmt.scene.table import ServedTable
from mmt_share.messages import TOKEN_VARIABLE, shared_at
from mmt_share.tables import Sharing

_LONGEST_S: Final = 30.0
_POLL_S: Final = 0.1
_PORT: Final = 8770
_EVERYWHERE: Final = {"", "0.0.0.0", "::"}  # noqa: S104 - compared with, not listened on
_ELSEWHERE: Final = ("192.0.2.1", 9)  # an address that nobody has (RFC 5737); nothing is sent


class VisitorsPage:
    """Serve the page from the moment that a model is shared, until `close`.

    Parameters
    ----------
    token
        Token that the leader asks of its listeners, or None.
    code
        Whether a QR code is shown.
    """

    def __init__(self, token: str | None = None, *, code: bool = True) -> None:
        self._token, self._code = token, code
        self._process: ChildProcess | None = None
        self.address: str | None = None
        """Address of the page, or None until it is served."""

    def start_on_event(self, sentence: str) -> Coroutine[Any, Any, str] | None:
        """Return a coroutine that serves the page if an event says that the model is shared."""
        url = shared_at(sentence)
        return None if url is None else self.open(url)

    @property
    def after_session(self) -> str | None:
        """Words that give the address of the page, or None before it is served."""
        return None if self.address is None else f"it can be felt at {self.address}"

    async def open(self, url: str) -> str:
        """Serve the model shared at a URL; return a text for the terminal when the page is up.

        The text gives the address and, if wanted and if `segno` is installed, a QR code. If the
        process has ended instead, the text says why.
        """
        port = _free_port()
        self._process = ChildProcess(
            *("-m", "mmt.cli.running.child", "main", "play", "--from", url),
            *("--host", "0.0.0.0", "--port", str(port), "--open"),  # noqa: S104 - it is asked for
            keeps_errors=True,
            stdout=subprocess.DEVNULL,
            env=os.environ | ({} if self._token is None else {TOKEN_VARIABLE: self._token}),
        )
        while self._process.poll() is None:
            with suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.close()
                self.address = f"http://{_own_address()}:{port}/player/"
                return f"feel it at {self.address}{qr_code(self.address) if self._code else ''}"
            await asyncio.sleep(_POLL_S)
        return f"no page for visitors: {self._process.close() or 'its process has ended'}"

    def wait(self) -> None:
        """Wait until the page's process ends.

        This polls, because a signal that comes just before a blocking wait would not end it.
        """
        while self._process is not None and self._process.poll() is None:
            time.sleep(_POLL_S)

    def close(self) -> None:
        """End the page's process."""
        process, self._process = self._process, None
        if process is not None:
            process.end(_LONGEST_S)
            process.close()


def visitors_page(scene: Scene, *, terminal: bool) -> VisitorsPage:
    """Return the page of a scene's shared model, with a QR code for a terminal.

    Raises
    ------
    InputError
        The token cannot be read, or the model is shared by TLS, for which the page needs a
        certificate of its own.
    """
    sharing = scene.table(Sharing) or Sharing()
    if sharing.certificate is not None:
        raise InputError(
            "a page for visitors needs a certificate that their browsers know: share without it, "
            "or leave the page out here and run mmt play --from URL --certificate FILE --key FILE"
        )
    return VisitorsPage(Access.from_settings(sharing, variable=TOKEN_VARIABLE).token, code=terminal)


def reachable_url(table: ServedTable, port: int) -> str:
    """Return the URL by which other machines reach a server with this table and port."""
    host = _own_address() if table.host in _EVERYWHERE else table.host
    return table.model_copy(update={"host": host}).url(port)


def _own_address() -> str:
    """Return this machine's address in its network, or its name without a network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as connection:
        try:
            connection.connect(_ELSEWHERE)
        except OSError:
            return socket.gethostname()
        return str(connection.getsockname()[0])


def qr_code(text: str) -> str:
    """Return lines that show a text as a QR code, or "" if `segno` is not installed."""
    try:
        import segno
    except ImportError:
        return ""
    lines = StringIO()
    segno.make(text).terminal(out=lines, compact=True, border=2)
    return f"\n{lines.getvalue().rstrip()}"


def _free_port() -> int:
    """Return the usual port, or any free one if it is taken."""
    for port in (_PORT, 0):
        with socket.socket() as connection, suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            connection.bind(("", port))
            return int(connection.getsockname()[1])
    return _PORT
