"""The vendor's library through ctypes: its constants, loading, and one stack for the process."""

import ctypes
import importlib
import os
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from mmt.core.errors import InputError, MmtError

DONE: Final = 0
CONTINUE: Final = 1
INVALID_HANDLE: Final = 0xFFFFFFFF
DEFAULT_PRIORITY: Final = 0xFFFF // 2

CURRENT_POSITION: Final = 0x2050
CURRENT_VELOCITY: Final = 0x2051
CURRENT_TRANSFORM: Final = 0x2052
MODEL: Final = 0x2501
SERIAL_NUMBER: Final = 0x2504
CALIBRATION_STYLE: Final = 0x2555
NOMINAL_MAX_STIFFNESS: Final = 0x2602
NOMINAL_MAX_FORCE: Final = 0x2603
CURRENT_FORCE: Final = 0x2700

FORCE_OUTPUT: Final = 0x4000
MAX_FORCE_CLAMPING: Final = 0x4001

CALIBRATION_OK: Final = 0x5000
CALIBRATION_NEEDS_UPDATE: Final = 0x5001
ENCODER_RESET: Final = 1
AUTO: Final = 2
INKWELL: Final = 4

WARM_MOTORS: Final = 0x0200
FORCE_ERROR: Final = 0x0204
DEVICE_FAULT: Final = 0x0300
COMM_ERROR: Final = 0x0302


class HdError(NamedTuple):
    """One entry of HD's stack of errors."""

    code: int
    internal: int
    """The device's own number for it."""


_REPORT: Final = "this is a mistake in the driver: please report it with this sentence"

SENTENCES: Final[dict[int, tuple[str, str, str]]] = {
    0x0100: ("INVALID_ENUM", "the library does not know what it was asked for",
             "take the driver package that belongs to this device"),
    0x0101: ("INVALID_VALUE", "a value was not accepted", _REPORT),
    0x0102: ("INVALID_OPERATION", "a call came where it is not allowed", _REPORT),
    0x0103: ("INVALID_INPUT_TYPE", "a kind of value was not accepted", _REPORT),
    0x0104: ("BAD_HANDLE", "the device is not open any more", "connect again"),
    0x0200: ("WARM_MOTORS", "the motors are too warm and give no force",
             "let go, let them cool for some minutes, and lower 'force_limit_n'"),
    0x0201: ("EXCEEDED_MAX_FORCE", "more force was asked for than the device can give",
             "lower 'force_limit_n' or the gains"),
    0x0202: ("EXCEEDED_MAX_FORCE_IMPULSE", "the force changed too fast",
             "lower 'stiffness_n_mm' or 'force_limit_n'"),
    0x0203: ("EXCEEDED_MAX_VELOCITY", "the tip moved too fast, the force was switched off",
             "hold the tip, and lower the gains if it trembles"),
    0x0204: ("FORCE_ERROR", "the force could not be set", "look at the emergency stop and power"),
    0x0300: ("DEVICE_FAULT", "the device has a fault or is not there",
             "check its power, its cable and its name in the vendor's set-up, then connect again"),
    0x0301: ("DEVICE_ALREADY_INITIATED", "it is in use already",
             "close the other program, or give the other device's name with 'device'"),
    0x0302: ("COMM_ERROR", "it does not answer",
             "check cable, power and who may open the port, then connect again"),
    0x0303: ("COMM_CONFIG_ERROR", "its port is not set up",
             "run the vendor's set-up program and choose the port"),
    0x0304: ("TIMER_ERROR", "the servo loop's timer failed", "restart the program or the machine"),
    0x0400: ("ILLEGAL_BEGIN", "a frame began within a frame", _REPORT),
    0x0401: ("ILLEGAL_END", "a frame ended that had not begun", _REPORT),
    0x0402: ("FRAME_ERROR", "a frame took longer than the servo's tick",
             "take load off this machine"),
    0x0500: ("INVALID_PRIORITY", "a priority was not accepted", _REPORT),
    0x0501: ("SCHEDULER_FULL", "the servo loop takes no further part", "close other devices"),
    0x0600: ("INVALID_LICENSE", "the OpenHaptics licence is missing or has run out",
             "install a valid licence"),
}  # fmt: skip


def name_of(code: int) -> str:
    """Return the vendor's name of an error, without its prefix."""
    return SENTENCES[code][0] if code in SENTENCES else f"0x{code:04X}"


def explain(device: str, error: HdError) -> str:
    """Return what was seen and what to do, for the device of this name."""
    name, seen, to_do = SENTENCES.get(
        error.code, (name_of(error.code), "an error that is not known", "look it up in hdDefines.h")
    )
    return f"{device}: {seen} (HD_{name}, device's own code {error.internal}): {to_do}"


def only_force(code: int) -> bool:
    """Return whether an error concerns the force alone: the device still measures."""
    return WARM_MOTORS <= code <= FORCE_ERROR


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


EMULATED: Final = "emulated"
"""Path that stands for the emulated library."""


def open_stack(path: str) -> Stack:
    """Return the process's driver stack; the first call loads it from `path`.

    Raises
    ------
    InputError
        The library cannot be used, or this process has loaded another one.
    """
    global _stack  # noqa: PLW0603 - a process has one, and it cannot be unloaded
    path = _emulated() if path == EMULATED else path
    with _stack_lock:
        if _stack is None:
            _stack = Stack(path)
        elif Path(_stack.path).resolve() != Path(path).resolve():
            raise InputError(
                f"this process already drives devices through {_stack.path}: a device that needs "
                f"{path} must be driven by another process, as leader or follower"
            )
        return _stack


def _emulated() -> str:
    return str(importlib.import_module("mmt.testing.emulated.openhaptics.hd").build_library())


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
