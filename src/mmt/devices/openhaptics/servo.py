"""The callback that the library's thread runs a thousand times a second: state out, force in."""

import ctypes
import math
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.core.guards import ForceGuard
from mmt.core.running.process import follow_real_time
from mmt.devices.openhaptics.library import (
    COMM_ERROR,
    CONTINUE,
    CURRENT_FORCE,
    CURRENT_POSITION,
    CURRENT_VELOCITY,
    DEVICE_FAULT,
    DONE,
    VECTOR,
    HdError,
    Vector3,
    name_of,
    only_force,
)
from mmt.devices.openhaptics.options import HdOptions
from mmt.devices.reading_checks import PlausibilityCheck

STUCK: Final = "a position that stays the same under the largest force"

_LONGEST_STEP_NS: Final = 10_000_000
_COOLING_NS: Final = 1_000_000_000
_MOST_ERRORS: Final = 8
_POSITION, _VELOCITY, _FORCE = (
    ctypes.c_uint32(name) for name in (CURRENT_POSITION, CURRENT_VELOCITY, CURRENT_FORCE)
)
"""Made once, since a conversion at each tick takes as long as the call."""


class Servo:
    """Callback of one device; it displays `force`, faded out while commands are stale.

    Other threads read `position` and `velocity`, which are replaced as a whole, and `displayed` by
    slicing it; they write `force` as a whole. The velocity may be a tick newer than the position
    read with it.

    A `request` runs once, within the next frame, and leaves its result in `answer`: HD allows one
    frame a tick, and some of its calls need a frame.

    Parameters
    ----------
    hd, copies
        The library, see `Stack`.
    handle
        Handle of the device.
    options
        The force fades to zero within `ramp_ms` if no command has come for `stale_ms`, and comes
        back as slowly. After an implausible measurement it is zero at once and comes back slowly.
    limit_n
        Largest force, along any direction.
    """

    def __init__(
        self,
        hd: Any,
        copies: Any,
        handle: int,
        options: HdOptions,
        limit_n: float,
    ) -> None:
        self._handle, self.clock = ctypes.c_uint32(handle), time.monotonic_ns
        self._begin, self._end, self._error = hd.hdBeginFrame, hd.hdEndFrame, copies.hdGetError
        self._get, self._set = copies.hdGetDoublev, copies.hdSetDoublev
        self._thread = 0
        self._stale_ns = round(options.stale_ms * 1e6)
        self._ramp_ns = round(options.ramp_ms * 1e6)
        self.position: Vector = (0.0, 0.0, 0.0)
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self._measured = Vector3(), Vector3()
        self._watch = PlausibilityCheck()
        self.senseless: tuple[str, int] | None = None
        """Problem of the measurements and the time (ns) of its start, or None."""
        self.force: Vector = (0.0, 0.0, 0.0)
        self.guard: Final = ForceGuard(limit_n, options.axes_limit_n)
        self.displayed = Vector3()
        self.command_ns: int | None = None
        self.share = 0.0
        self.ticks = 0
        self.tick_ns = self.clock()
        self.bad_since_ns: int | None = None
        self.fault: HdError | None = None
        self.failure: Exception | None = None
        self.counts: Counter[str] = Counter()
        self.request: Callable[[], object] | None = None
        self.answer: object = None
        self.newest_force_error: HdError | None = None
        self._rest_until_ns = 0

    def run_in_frame(self, function: Callable[[], object]) -> None:
        """Have a function run within the next frame; it has run once `request` is None again."""
        self.answer, self.request = None, function

    def accepts(self, command: Vector) -> bool:
        """Return whether a command is finite, and count it if it is not."""
        x, y, z = command
        if math.isfinite(x + y + z):
            return True
        self.counts["commands that are not finite"] += 1
        return False

    def tick(self, _: Any) -> int:
        """Do one frame; the library calls it."""
        try:
            now_ns = self.clock()
            if threading.get_ident() != self._thread:
                self._settle_in()
            self._begin(self._handle)
            self._measure(now_ns)
            if self.request is not None:
                self.answer, self.request = self.request(), None
            self._fade(now_ns)
            self._display(self.drive(now_ns))
            self._set(_FORCE, self.displayed)
            self._end(self._handle)
            error = self._error()
            if error.code:
                self._note(error, now_ns)
            else:
                self.bad_since_ns = None
            self.tick_ns = now_ns
            self.ticks += 1
        except Exception as failure:  # noqa: BLE001 - it cannot be raised through the library
            self.failure = failure
            self.displayed[:] = (0.0, 0.0, 0.0)
            self._set(_FORCE, self.displayed)  # HD does not say that an unset force is none
            self._end(self._handle)
            return DONE
        return CONTINUE

    def _settle_in(self) -> None:
        """Prepare the library's own thread, a new one after each start of its scheduler.

        For each call from a foreign thread the interpreter makes a thread state and maps memory,
        a quarter of a tick's cost, unless a state is held. This one is held until the process ends.
        """
        self._thread = threading.get_ident()
        ctypes.pythonapi.PyGILState_Ensure()
        follow_real_time()

    def _measure(self, now_ns: int) -> None:
        """Take position and velocity if they are plausible; else the last ones stay."""
        of_position, of_velocity = self._measured
        self._get(_POSITION, of_position)
        self._get(_VELOCITY, of_velocity)
        position: Vector = VECTOR.unpack_from(of_position)
        velocity: Vector = VECTOR.unpack_from(of_velocity)
        problem = self._watch.problem(position, velocity, now_ns)
        if problem is None:
            if self.senseless is not None and self._moves(position):
                self.senseless = None
            self.position, self.velocity = position, velocity
        else:
            self.distrust(problem, now_ns)

    def accept_next_position(self) -> None:
        """Accept the next position wherever it is: a calibration moves the zero."""
        self._watch = PlausibilityCheck()

    def _moves(self, position: Vector) -> bool:
        """Return whether a plausible position ends the problem: a stuck one must have changed."""
        stuck = self.senseless is not None and self.senseless[0] == STUCK
        return not stuck or position != self.position

    def distrust(self, problem: str, since_ns: int) -> None:
        """Switch the force off: measurements have been implausible since this time or longer."""
        self.counts[problem] += 1
        self.share = 0.0
        first_ns = since_ns if self.senseless is None else self.senseless[1]
        self.senseless = (problem, first_ns)

    def drive(self, now_ns: int) -> Vector:  # noqa: ARG002 - a controller needs it
        """Return the commanded force of this tick, before it is limited and faded."""
        return self.force

    def _display(self, force_n: Vector) -> None:
        """Set `displayed`, the final force: finite, within the limit, and faded."""
        bad = self.guard.not_finite
        self.displayed[:] = self.guard.step(force_n, self.share)
        if self.guard.not_finite != bad:
            self.counts["forces that are not finite"] += 1

    def _fade(self, now_ns: int) -> None:
        """Set the share of the force that is displayed now."""
        passed_ns = now_ns - self.tick_ns
        change = (passed_ns if passed_ns < _LONGEST_STEP_NS else _LONGEST_STEP_NS) / self._ramp_ns
        command_ns = self.command_ns
        if now_ns < self._rest_until_ns or self.fault is not None or self.senseless is not None:
            self.share = 0.0
        elif command_ns is not None and now_ns - command_ns < self._stale_ns:
            self.share = self.share + change if self.share + change < 1.0 else 1.0
        elif self.share > 0.0:
            if self.share == 1.0:
                self.counts["stale commands"] += 1
            self.share = self.share - change if self.share > change else 0.0

    def _note(self, error: Any, now_ns: int) -> None:
        """Count the frame's errors, and switch the force off after them."""
        answers = True
        for _ in range(_MOST_ERRORS):
            if not error.code:
                break
            found = HdError(error.code, error.internal)
            self.counts[name_of(found.code)] += 1
            if only_force(found.code):
                self.newest_force_error = found
                self._rest_until_ns = now_ns + _COOLING_NS
            elif found.code == COMM_ERROR:
                answers = False
                self.share = 0.0
            elif found.code >= DEVICE_FAULT and found.code < 0x0400:
                self.fault = self.fault or found
                self.share = 0.0
            error = self._error()
        if answers:
            self.bad_since_ns = None
        elif self.bad_since_ns is None:
            self.bad_since_ns = now_ns
