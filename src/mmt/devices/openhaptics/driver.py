"""Base class of arm and handle: one HD device from `connect` to `close`, in a scene's axes."""

import atexit
import ctypes
import logging
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Final, Generic, TypeVar

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.axes import Axes
from mmt.devices.openhaptics import library as hd
from mmt.devices.openhaptics.library import CALLBACK, HdError, Stack, explain, open_stack
from mmt.devices.openhaptics.options import HdOptions
from mmt.devices.openhaptics.servo import Servo

LOG: Final = logging.getLogger("mmt.devices.openhaptics")

_LOST_NS: Final = 100_000_000
"""The device is lost if it does not answer for this long, frame after frame."""
_STOPPED_NS: Final = 1_000_000_000
"""The device is lost if the library does not call for this long: its thread ended or is stuck."""
_FIRST_TICK_S: Final = 5.0
_POLL_S: Final = 0.02
_SHORT_S: Final = 2e-5
_FASTER_POLLS_S: Final = 1.0

_STYLES: Final = (hd.AUTO, hd.INKWELL, hd.ENCODER_RESET)
_WHAT_TO_DO: Final = {
    hd.AUTO: "move the tip slowly through its whole space until it is calibrated",
    hd.INKWELL: "put the stylus into the inkwell and leave it there for a moment",
    hd.ENCODER_RESET: "hold the arm in its reset position (see the device's manual), set "
    "'reset_encoders = true', start again and do not move it until the run begins",
}


AnyServo = TypeVar("AnyServo", bound=Servo)


class HdDriver(ABC, Generic[AnyServo]):
    """A `Device`; a subclass adds its servo, `read` and `write`.

    Parameters
    ----------
    options
        Validated options.
    """

    def __init__(self, options: HdOptions) -> None:
        self._options = options
        self._axes = Axes(options.axes, options.origin_mm)
        self._stack: Stack | None = None
        self._handle = hd.INVALID_HANDLE
        self._servo: AnyServo | None = None
        self._callback: object = None
        self._scheduled: int | None = None
        self._counts: Counter[str] = Counter()  # of all its connections
        self._said: HdError | None = None
        self._calibrated = False
        self.name = f"OpenHaptics device {options.device or '(default)'}"

    @abstractmethod
    def _make_servo(
        self, stack: Stack, handle: int, limit_n: float, stiffness_n_mm: float
    ) -> AnyServo:
        """Make the callback for the device's handle, force limit (N) and largest stiffness."""

    def connect(self) -> None:
        """Open the device and start the servo, with no force until the first command.

        Raises
        ------
        InputError
            The library cannot be used, or the device cannot do what the options ask for.
        MmtError
            The device does not answer.
        """
        self._disconnect()
        stack = open_stack(self._options.library)
        try:
            with stack.rearranged(devices=1):
                self._open(stack)
                self._stack = stack
            self._wait_for_tick()
            if self._calibrated:  # it was reconnected, perhaps after a loss of power
                self.calibrate()
        except BaseException:
            self._disconnect()
            raise
        atexit.register(self._disconnect)

    def _open(self, stack: Stack) -> None:
        stack.pop_errors()  # left by a closed device
        name = self._options.device
        handle = stack.hd.hdInitDevice(name.encode() if name is not None else None)
        errors = stack.pop_errors()
        if errors or handle == hd.INVALID_HANDLE:
            seen = explain(self.name, errors[0] if errors else HdError(hd.DEVICE_FAULT, 0))
            raise MmtError(seen + _closed_ports())
        self._handle = handle
        try:
            stack.hd.hdMakeCurrentDevice(handle)
            model = stack.hd.hdGetString(hd.MODEL)
            serial = stack.hd.hdGetString(hd.SERIAL_NUMBER)
            texts = [text.decode(errors="replace") for text in (model, serial) if text]
            self.name = " ".join(texts) or self.name
            stack.hd.hdEnable(hd.FORCE_OUTPUT)
            stack.hd.hdEnable(hd.MAX_FORCE_CLAMPING)
            stiffness_n_mm = _double(stack, hd.NOMINAL_MAX_STIFFNESS)
            servo = self._make_servo(stack, handle, self._force_limit_n(stack), stiffness_n_mm)
            servo.counts = self._counts
            self._callback = CALLBACK(servo.tick)
            self._scheduled = stack.hd.hdScheduleAsynchronous(
                self._callback, None, hd.DEFAULT_PRIORITY
            )
            stack.check(self.name)
        except BaseException:
            self._release(stack)
            raise
        self._servo = servo

    def _force_limit_n(self, stack: Stack) -> float:
        """Return the lower of the scene's limit and the device's own."""
        largest_n = _double(stack, hd.NOMINAL_MAX_FORCE)
        stack.check(self.name)
        if not largest_n > 0.0:
            raise MmtError(
                f"{self.name} says that its largest force is {largest_n:g} N, so that no limit is "
                "known: check it with the vendor's diagnosis program"
            )
        return min(self._options.whole_limit_n, largest_n)

    def _wait_for_tick(self) -> None:
        deadline = time.monotonic() + _FIRST_TICK_S
        while not self.servo.ticks:
            self.check()
            if time.monotonic() > deadline:
                raise MmtError(f"{self.name}: the servo loop does not start: reinstall its driver")
            time.sleep(0.001)

    def await_turn(self) -> None:
        """Return soon after the servo's next tick, or after 20 ms."""
        servo = self.servo
        ticks, deadline = servo.ticks, time.monotonic() + _POLL_S
        while servo.ticks == ticks and time.monotonic() < deadline:
            time.sleep(_SHORT_S)

    def calibrate(self) -> None:
        """Calibrate the encoders in the device's own way; the option `origin_mm` sets the zero.

        Raises
        ------
        MmtError
            The operator must do something first; the message says what.
        """
        stack = self._connected()
        offered = ctypes.c_int32()
        stack.hd.hdMakeCurrentDevice(self._handle)
        stack.hd.hdGetIntegerv(hd.CALIBRATION_STYLE, offered)
        stack.check(self.name)
        style = next((each for each in _STYLES if offered.value & each), None)
        if style is None:
            return
        reset = style == hd.ENCODER_RESET and self._options.reset_encoders and not self._calibrated
        began = time.monotonic()
        told = False
        while True:
            status = self._in_frame(partial(self._calibrate_once, stack, style, reset=reset))
            waited_s = time.monotonic() - began
            if status == hd.CALIBRATION_OK:
                self._calibrated = True
                return
            patience_s = 0.0 if style == hd.ENCODER_RESET else self._options.calibration_s
            if status == hd.CALIBRATION_NEEDS_UPDATE:
                patience_s = max(patience_s, _FASTER_POLLS_S)
            if waited_s > patience_s and not reset:
                raise MmtError(f"{self.name} is not calibrated: {_WHAT_TO_DO[style]}")
            if not told and waited_s > _POLL_S:
                LOG.warning("%s is not calibrated: %s", self.name, _WHAT_TO_DO[style])
                told = True
            reset = False
            time.sleep(_POLL_S)

    def _in_frame(self, function: Callable[[], object]) -> object:
        """Run a function within the servo's next frame and return its result."""
        servo = self.servo
        servo.run_in_frame(function)
        while servo.request is not None:
            self.check()
            time.sleep(0.001)
        if isinstance(servo.answer, MmtError):
            raise servo.answer
        return servo.answer

    def _calibrate_once(self, stack: Stack, style: int, *, reset: bool) -> int | MmtError:
        """Update the calibration if it is due; return the state before. Runs within a frame."""
        status: int = stack.hd.hdCheckCalibration()
        if reset or (status == hd.CALIBRATION_NEEDS_UPDATE and style != hd.ENCODER_RESET):
            stack.hd.hdUpdateCalibration(style)
        self.servo.accept_next_position()
        errors = stack.pop_errors()
        return MmtError(explain(self.name, errors[0])) if errors else status

    def close(self) -> None:
        """Switch the force off and release the device; calling it twice is harmless."""
        self._disconnect()

    def _disconnect(self) -> None:
        """Release the device; what a subclass does beside in `close` is left as it is."""
        stack, self._stack = self._stack, None
        atexit.unregister(self._disconnect)
        if stack is None:
            return
        with stack.rearranged(devices=-1):
            self._release(stack)
        self._servo = None

    def _release(self, stack: Stack) -> None:
        if self._scheduled is not None:
            stack.hd.hdUnschedule(self._scheduled)
        stack.hd.hdMakeCurrentDevice(self._handle)
        stack.hd.hdDisable(hd.FORCE_OUTPUT)
        stack.hd.hdDisableDevice(self._handle)
        stack.pop_errors()  # a device that is gone reports an error for each of these calls
        self._scheduled = self._callback = None
        self._handle = hd.INVALID_HANDLE

    @property
    def servo(self) -> AnyServo:
        """The running callback.

        Raises
        ------
        DeviceLost
            The device is closed.
        """
        if self._servo is None:
            raise DeviceLost(f"{self.name} is not connected: connect it first")
        return self._servo

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind."""
        return dict(self._counts)

    def check(self) -> AnyServo:
        """Return the callback if the device works.

        Raises
        ------
        DeviceLost
            The device does not answer any more.
        MmtError
            The driver itself failed.
        """
        servo = self.servo
        now_ns = time.monotonic_ns()
        if servo.failure is not None:
            raise MmtError(f"{self.name}: the servo callback failed: {servo.failure!r}")
        if servo.fault is not None:
            raise DeviceLost(explain(self.name, servo.fault))
        bad_since_ns = servo.bad_since_ns
        if bad_since_ns is not None and now_ns - bad_since_ns > _LOST_NS:
            raise DeviceLost(explain(self.name, HdError(hd.COMM_ERROR, 0)))
        senseless = servo.senseless
        if senseless is not None and now_ns - senseless[1] > _LOST_NS:
            raise DeviceLost(
                f"{self.name} has given {senseless[0]} for 100 ms or more: the force is off; "
                "check that nothing holds the arm, its cable and its calibration"
            )
        since_ns = self._stack.running_since_ns if self._stack is not None else None
        if since_ns is not None and now_ns - max(servo.tick_ns, since_ns) > _STOPPED_NS:
            raise DeviceLost(
                f"{self.name}: the servo loop has stopped: check cable and power, connect again"
            )
        if servo.newest_force_error is not self._said:
            self._say(servo.newest_force_error)
        return servo

    def _say(self, error: HdError | None) -> None:
        """Warn once why there is no force."""
        if error is not None and (self._said is None or self._said.code != error.code):
            LOG.warning("%s", explain(self.name, error))
        self._said = error

    def _connected(self) -> Stack:
        if self._stack is None:
            raise DeviceLost(f"{self.name} is not connected: connect it first")
        return self._stack


def _double(stack: Stack, what: int) -> float:
    value = ctypes.c_double()
    stack.hd.hdGetDoublev(what, value)
    return value.value


def _closed_ports() -> str:
    """Return a text about serial ports that this user may not open, or ''."""
    from mmt.devices.discovery import find_serial_ports

    with suppress(MmtError):  # pyserial may be missing, which this driver does not need
        return "".join(f"; {port.problem}" for port in find_serial_ports() if port.problem)
    return ""
