"""Reading a serial port without waiting."""

import os
import sys
from types import SimpleNamespace

import pytest

from mmt.core.errors import MmtError
from mmt.devices import serial_ports
from mmt.devices.serial_ports import SerialLine, read_waiting

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo terminals")


def read_nothing(descriptor, most):
    pytest.fail("an empty port was read, which waits for what is under way")


def test_a_port_with_nothing_in_it_is_not_read(monkeypatch):
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    port = SimpleNamespace(fd=slave)
    with monkeypatch.context() as patched:
        patched.setattr(serial_ports.os, "read", read_nothing)
        assert read_waiting(port, 100) == b""
    os.write(master, bytes(300))
    received = b""
    while len(received) < 300:
        piece = read_waiting(port, 100)
        assert len(piece) <= 100
        received += piece
    os.close(slave)
    os.close(master)


def test_a_port_that_is_gone_is_an_error():
    master, slave = os.openpty()
    os.close(master)
    with pytest.raises(OSError, match="Input/output error"):
        read_waiting(SimpleNamespace(fd=slave), 100)
    os.close(slave)
    with pytest.raises(TypeError):
        read_waiting(SimpleNamespace(fd=None), 100)


def test_a_file_that_is_no_port_is_told_of_with_what_to_check():
    with pytest.raises(MmtError, match=r"^board: .+ioctl.+; check that it is a serial port, and"):
        SerialLine("board", os.devnull, 9600).open()
