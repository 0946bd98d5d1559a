"""The vendor's library through ctypes: loading it, its types, one driver stack a process."""

import ctypes
import os
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.devices.drivers import library_file
from mmt.devices.openhaptics.constants import HdError, explain

CALLBACK: Final = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)
Vector3: Final[Any] = ctypes.c_double * 3
VECTOR: Final = struct.Struct("3d")
"""Takes the numbers out of one, all at once."""

_MOST_ERRORS: Final = 64


class ErrorInfo(ctypes.Structure):
    """``HDErrorInfo``, which the library returns by value."""

    _fields_ = (
        ("code", ctypes.c_uint32),
        ("internal", ctypes.c_int32),
        ("device", ctypes.c_uint32),
    )


_DOUBLES: Final = ctypes.POINTER(ctypes.c_double)
_COPIES: Final[dict[str, tuple[Any, list[Any] | None]]] = {
    "hdGetDoublev": (None, None),
    "hdSetDoublev": (None, None),
    "hdGetError": (ErrorInfo, []),
}
"""Without types of arguments: converting them takes longer than the call. They are given as what
they are, `ctypes.c_uint32` and `Vector3`."""
_PROTOTYPES: Final[dict[str, tuple[Any, list[Any] | None]]] = {
    "hdGetDoublev": (None, [ctypes.c_uint32, _DOUBLES]),
    "hdSetDoublev": (None, [ctypes.c_uint32, _DOUBLES]),
    "hdGetError": (ErrorInfo, []),
    "hdBeginFrame": (None, [ctypes.c_uint32]),
    "hdEndFrame": (None, [ctypes.c_uint32]),
    "hdInitDevice": (ctypes.c_uint32, [ctypes.c_char_p]),
    "hdDisableDevice": (None, [ctypes.c_uint32]),
    "hdMakeCurrentDevice": (None, [ctypes.c_uint32]),
    "hdEnable": (None, [ctypes.c_uint32]),
    "hdDisable": (None, [ctypes.c_uint32]),
    "hdGetIntegerv": (None, [ctypes.c_uint32, ctypes.POINTER(ctypes.c_int32)]),
    "hdGetString": (ctypes.c_char_p, [ctypes.c_uint32]),
    "hdCheckCalibration": (ctypes.c_uint32, []),
    "hdUpdateCalibration": (None, [ctypes.c_uint32]),
    "hdStartScheduler": (None, []),
    "hdStopScheduler": (None, []),
    "hdScheduleAsynchronous": (ctypes.c_ulong, [CALLBACK, ctypes.c_void_p, ctypes.c_uint16]),
    "hdUnschedule": (None, [ctypes.c_ulong]),
}


class Stack:
    """One driver stack: the library, and the scheduler that its devices share.

    Parameters
    ----------
    path
        As the scene names it.

    Attributes
    ----------
    hd
        The library. Its calls let go of the interpreter, so that one that waits, for the
        servo loop or the device, holds up no other thread.
    copies
        The same library for what only copies numbers. These calls keep the interpreter, which
        to let go of and to wait for costs more than they do.
    running_since_ns
        When the scheduler was started the last time, None while it stands.

    Raises
    ------
    InputError
        The library is not there, may not be read, or is another one.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._lock = threading.RLock()
        self._running = 0
        self.running_since_ns: int | None = None
        try:
            self.hd: Any = ctypes.CDLL(path)
            self.copies: Any = ctypes.PyDLL(path)
            _declare(self.hd, _PROTOTYPES)
            _declare(self.copies, _COPIES)
        except (OSError, AttributeError) as error:
            raise InputError(_not_loaded(path, error)) from error

    @contextmanager
    def rearranged(self, devices: int = 0) -> Iterator[None]:
        """Stop the scheduler for as long as devices come or go, `devices` of them."""
        with self._lock:
            if self._running:
                self.running_since_ns = None
                self.hd.hdStopScheduler()
            try:
                yield
                self._running += devices
            finally:
                if self._running:
                    self.hd.hdStartScheduler()
                    self.running_since_ns = time.monotonic_ns()

    def pop_errors(self) -> list[HdError]:
        """Return what lies on the stack of errors, newest first, and empty it."""
        errors = []
        for _ in range(_MOST_ERRORS):
            error = self.hd.hdGetError()
            if not error.code:
                break
            errors.append(HdError(error.code, error.internal))
        return errors

    def check(self, device: str) -> None:
        """Raise for the newest error of this thread's calls.

        Raises
        ------
        MmtError
            There is one.
        """
        errors = self.pop_errors()
        if errors:
            raise MmtError(explain(device, errors[0]))


_stack: Stack | None = None
_stack_lock = threading.Lock()


def open_stack(path: str) -> Stack:
    """Return the process's driver stack, loaded from `path` where there is none yet.

    Raises
    ------
    InputError
        The library cannot be used, or this process has another one.
    """
    global _stack  # noqa: PLW0603 - a process has one, and it cannot be unloaded
    path = library_file(path)
    with _stack_lock:
        if _stack is None:
            _stack = Stack(path)
        elif Path(_stack.path).resolve() != Path(path).resolve():
            raise InputError(
                f"this process already drives devices through {_stack.path}: a device that needs "
                f"{path} must be driven by another process, as leader or follower"
            )
        return _stack


def _declare(library: Any, prototypes: dict[str, tuple[Any, list[Any] | None]]) -> None:
    for name, (result, arguments) in prototypes.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments


def _not_loaded(path: str, error: Exception) -> str:
    if isinstance(error, AttributeError):
        return f"{path} is no OpenHaptics HD library ({error}): give the path of libHD.so"
    if "/" in path and not Path(path).exists():
        to_do = "there is no such file: install the OpenHaptics package, or correct 'library'"
    elif "/" in path and not os.access(path, os.R_OK):
        to_do = "you may not read it: ask its owner for the permission (chmod a+rx)"
    else:
        to_do = "install the device's driver package, or give the library's path with 'library'"
    return f"the OpenHaptics library {path} cannot be loaded ({error}): {to_do}"
