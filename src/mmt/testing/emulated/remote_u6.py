"""An emulated LabJack U6 in another process: its bulk transfers over local sockets.

A request is an endpoint, a time-out (ms) and the bytes to write, none for a read. The answer is an
error number of the system, 0 for none, and the bytes read.
"""

import errno
import os
import socket
import struct
import tempfile
import threading
import time
from array import array
from pathlib import Path
from typing import Any, Final

import usb.core

from mmt.devices.labjack.usb_link import PRODUCT, VENDOR
from mmt.testing.emulated.labjack_u6 import ENDPOINTS, EmulatedU6
from mmt.testing.emulated.usb_backend import OneDeviceBackend, UsbHandle

_REQUEST: Final = struct.Struct("<BH")
_LARGEST: Final = 4096
_PACKET: Final = 64


class U6Server:
    """Serves an emulated U6 at a socket's path.

    Parameters
    ----------
    box
        The emulated U6.
    """

    def __init__(self, box: EmulatedU6) -> None:
        self._box = box
        self._folder = tempfile.TemporaryDirectory(prefix="mmt-u6-")
        self.address = str(Path(self._folder.name) / "u6")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def start(self) -> None:
        """Start to listen."""
        self._socket.bind(self.address)
        self._socket.listen()
        threading.Thread(target=self._accept, name="U6 server", daemon=True).start()

    def stop(self) -> None:
        """Stop, and remove the socket."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._folder.cleanup()

    def _accept(self) -> None:
        while True:
            try:
                link, _ = self._socket.accept()
            except OSError:  # stopped
                return
            threading.Thread(target=self._serve, args=(link,), name="U6 pipe", daemon=True).start()

    def _serve(self, link: socket.socket) -> None:
        with link:
            handle = self._box.open_device(None)
            while request := link.recv(_LARGEST):
                endpoint, timeout_ms = _REQUEST.unpack_from(request)
                content = request[_REQUEST.size :]
                link.send(self._transfer(handle, endpoint, timeout_ms, content))

    def _transfer(self, handle: UsbHandle, endpoint: int, timeout_ms: int, content: bytes) -> bytes:
        try:
            if content:
                self._box.bulk_write(handle, endpoint, 0, content, timeout_ms)
                return _answer(0)
            buffer = array("B", bytes(_PACKET))
            count = self._box.bulk_read(handle, endpoint, 0, buffer, timeout_ms)
            return _answer(0) + buffer[:count].tobytes()
        except usb.core.USBError as error:
            return _answer(error.errno)


class RemoteU6(OneDeviceBackend):
    """A remote U6, given to the driver as its `backend`; each endpoint has a socket of its own.

    Parameters
    ----------
    address
        Address of the `U6Server`.
    """

    def __init__(self, address: str) -> None:
        super().__init__(VENDOR, PRODUCT, ENDPOINTS)
        self.own_ns = 0
        """Processor time of its transfers so far; those of libusb would take some, too."""
        self._pipes = {}
        for endpoint in ENDPOINTS:
            pipe = self._pipes[endpoint] = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            pipe.connect(address)

    def close(self) -> None:
        """Leave the server."""
        for pipe in self._pipes.values():
            pipe.close()

    def bulk_write(self, dev_handle: UsbHandle, ep: int, intf: int, data: Any, timeout: int) -> int:  # noqa: ARG002
        """Send the bytes to the server."""
        self._ask(ep, timeout, bytes(data))
        return len(data)

    def bulk_read(self, dev_handle: UsbHandle, ep: int, intf: int, buff: Any, timeout: int) -> int:  # noqa: ARG002
        """Read bytes from the server."""
        content = self._ask(ep, timeout, b"")
        buff[: len(content)] = array("B", content)
        return len(content)

    def _ask(self, endpoint: int, timeout_ms: int, content: bytes) -> bytes:
        pipe = self._pipes[endpoint]
        began_ns = time.thread_time_ns()
        try:
            pipe.send(_REQUEST.pack(endpoint, timeout_ms) + content)
            answer = pipe.recv(_LARGEST)
        except OSError as error:
            raise usb.core.USBError(error.strerror, errno=error.errno) from error
        finally:
            self.own_ns += time.thread_time_ns() - began_ns
        if not answer:
            raise usb.core.USBError("No such device", errno=errno.ENODEV)
        number = answer[0]
        if number == errno.ETIMEDOUT:
            raise usb.core.USBTimeoutError(os.strerror(number), errno=number)
        if number:
            raise usb.core.USBError(os.strerror(number), errno=number)
        return answer[1:]


def _answer(number: int) -> bytes:
    return bytes((number,))
