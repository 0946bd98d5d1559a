"""What the leader listens with: Socket.IO and HTTP pages on one port."""

from collections.abc import Iterable

from mmt.link.access import Access
from mmt.link.direct import ServerSockets
from mmt.link.listening import CLOSE_TIMEOUT_S, Listener, guarded_application, make_server
from mmt.link.pages import Page
from mmt.link.protocol import PING_TIMEOUT_S
from mmt.scene import Link


class LinkHost:
    """A Socket.IO server and pages for who may see them.

    Parameters
    ----------
    settings
        Where to listen; port 0 takes any free one.
    access
        What is asked of who connects.
    pages
        What is served beside Socket.IO.
    """

    def __init__(self, settings: Link, access: Access, pages: Iterable[Page]) -> None:
        self._settings = settings
        self._access = access
        self.server = make_server(PING_TIMEOUT_S)
        self.application = guarded_application(access)
        self.server.attach(self.application)
        for add_page in pages:
            add_page(self.application, access)
        self.sockets = ServerSockets(self.server, self.application)
        self._listener = Listener(self.application)

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        InputError
            Strangers could connect and the scene does not allow it, or a certificate cannot
            be used.
        MmtError
            The host or the port cannot be had.
        """
        settings = self._settings
        await self._listener.start(
            settings.host, settings.port, self._access, allowed=settings.open
        )

    async def stop(self) -> None:
        """Close all connections and stop listening; nothing happens where nothing is open."""
        if self.port:
            await self.sockets.close(CLOSE_TIMEOUT_S)
            await self.server.shutdown()
            await self._listener.stop()
