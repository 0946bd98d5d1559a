"""The virtual lab's side of an NI board: force and acceleration at the tip, over UDP."""

import socket
import struct
import threading
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from mmt.testing.emulated import Clockwork
    from mmt.testing.emulated.lab import World

ANSWER_S: Final = 1.0
LARGEST_BYTES: Final = 65_536
_TIME_BYTES: Final = 8


class FeltByTip:
    """Answers datagrams of monotonic times (ns) with force (N) and acceleration (m/s2) at each.

    Parameters
    ----------
    world
        World with the tip.
    """

    def __init__(self, world: "World") -> None:
        self._world = world
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="NI board", daemon=True)

    @property
    def options(self) -> dict[str, Any]:
        """UDP port at which it answers."""
        return {"port": self._socket.getsockname()[1]}

    def start(self) -> None:
        """Start answering."""
        self._thread.start()

    def stop(self) -> None:
        """Stop answering, and close the socket."""
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        world = self._world
        while not self._ended.is_set():
            try:
                asked, peer = self._socket.recvfrom(LARGEST_BYTES)
            except TimeoutError:
                continue
            felt: list[float] = []
            for time_ns in struct.unpack(f"<{len(asked) // _TIME_BYTES}q", asked):
                felt += (*world.force_n(time_ns), *world.acceleration_m_s2(time_ns))
            self._socket.sendto(struct.pack(f"<{len(felt)}d", *felt), peer)


def in_lab(world: "World", _seed: int, _clockwork: "Clockwork") -> FeltByTip:
    """Return the lab's side of the NI board."""
    return FeltByTip(world)
