"""Serial ports: why one cannot be opened, in a sentence, and reading one without waiting."""

import errno
import os

import serial
from serial.tools import list_ports


def read_waiting(port: serial.Serial, most: int) -> bytes:
    """Return what has come to a port whose time-out is 0.

    Where something has, that is one call of the system and not three as by pyserial, which is
    asked where nothing has: it knows a port that is gone from one that is silent.

    Raises
    ------
    OSError
        The port is gone.
    """
    descriptor: int | None = getattr(port, "fd", None)  # on POSIX
    if descriptor is not None:
        try:
            if received := os.read(descriptor, most):
                return received
        except BlockingIOError:
            return b""
    return bytes(port.read(most))


def explain_refusal(error: Exception) -> str:
    """Return why a port cannot be opened, with what to do."""
    code = getattr(error, "errno", None)
    if code == errno.EACCES:
        return (
            "no permission. On Linux add yourself to the group that owns it (dialout or uucp: "
            "sudo usermod -aG dialout $USER) and log in again"
        )
    if code in {errno.ENOENT, errno.ENXIO, errno.ENODEV}:
        ports = [str(info.device) for info in list_ports.comports()]
        return f"there is none; plug the board in. There are: {', '.join(ports) or 'no ports'}"
    if code in {errno.EBUSY, errno.EAGAIN}:
        return "another program has it open; close that one (a serial monitor, another session)"
    return str(error)
