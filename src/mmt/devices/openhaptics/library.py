"""The vendor's library through ctypes: loading, types, and one driver stack for the process."""

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
Matrix: Final[Any] = ctypes.c_double * 16
VECTOR: Final = struct.Struct("3d")
"""Unpacks all numbers of a `Vector3` at once."""

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
"""No argument types, since converting takes longer than the call: callers pass `ctypes.c_uint32`
and `Vector3`."""
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
        File of the library.

    Attributes
    ----------
    hd
        The library. Its calls release the interpreter lock, so that a call that waits for the
        servo loop or the device holds up no other thread.
    copies
        The same library for calls that only copy numbers. They keep the interpreter lock:
        releasing it and waiting for it would cost more than the call.
    running_since_ns
        Time of the scheduler's last start, None while it is stopped.

    Raises
    ------
    InputError
        The library is missing, may not be read, or is no HD library.
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
        """Stop the scheduler while the number of devices changes, by `devices`."""
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
        """Empty the stack of errors and return them, newest first."""
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
            There is an error.
        """
        errors = self.pop_errors()
        if errors:
            raise MmtError(explain(device, errors[0]))


_stack: Stack | None = None
_stack_lock = threading.Lock()


def open_stack(path: str) -> Stack:
    """Return the process's driver stack; the first call loads it from `path`.

    Raises
    ------
    InputError
        The library cannot be used, or this process has loaded another one.
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
