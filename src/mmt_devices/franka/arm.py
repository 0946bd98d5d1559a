"""Connection to one Franka arm, in a thread that reads and commands the arm.

The arm takes one connection, which the drivers of robot and force sensor share. The code follows
the Python interface of franky 2.0 (github.com/TimSchneider42/franky); libfranka's `RobotState`
defines the fields of a state.
"""

import atexit
import importlib
import logging
import threading
import time
from typing import Any, Final, NamedTuple

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.quaternions import Quaternion
from mmt.core.running.process import follow_real_time
from mmt_devices.franka.control import PositionControl
from mmt_devices.franka.options import ArmOptions
from mmt_devices.franka.problems import OF_MODE, ArmProblem, explain, is_of_arm

LOG: Final = logging.getLogger("mmt_devices.franka")

_PERIOD_NS: Final = 1_000_000
_SILENT_NS: Final = 500_000_000
"""Longest time without a new state; a robot sends 1000 states a second."""
_SILENT_TURNS: Final = 20
"""A loss also takes this many turns, since this thread may have been held up."""
_STUCK_NS: Final = 1_500_000_000
"""Longest time of a call; the library gives up a connection after a second."""
_CONNECT_S: Final = 10.0
_END_S: Final = 5.0
_SHORT_S: Final = 2e-5
_TURN_S: Final = 0.02


class ArmState(NamedTuple):
    """Newest state of the robot, in its base frame."""

    time_ms: int
    """By the robot's own clock."""
    position_mm: Vector
    """Of the end effector."""
    force_n: Vector
    """Force of the touched surface on the tool; all zero near a singularity."""
    orientation: Quaternion
    """Of the end effector."""


class FrankaArm(threading.Thread):
    """Connection to an arm; ends by itself when the arm is lost, and is not used again.

    Parameters
    ----------
    options
        Address of the arm, and whether real time is enforced.
    franky
        The library.
    """

    def __init__(self, options: ArmOptions, franky: Any) -> None:
        super().__init__(name=f"Franka arm {options.host}", daemon=True)
        self.options = options
        self.franky = franky
        self.ended = threading.Event()
        """Set when no driver uses the connection any more."""
        self.users = 0
        self.ready = threading.Event()
        """Set when the arm is connected, or connecting has failed."""
        self.loss: str | None = None
        """Why the arm is lost, None while it is not."""
        self._failure: Exception | None = None
        self.state = ArmState(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        self.control: PositionControl | None = None
        self.turns = 0
        self.turn_ns = time.monotonic_ns()
        self._due_ns = 0
        self._fresh_ns, self._silent = 0, 0

    def run(self) -> None:
        """Connect, then read and command the arm until it is lost or no longer used."""
        robot = None
        try:
            follow_real_time()
            robot = self._open()
            self.turn_ns = time.monotonic_ns()
            self.ready.set()
            _end_if_unused(self)
            while self.control is not None or not self.ended.is_set():
                self._turn(robot)
        except Exception as error:  # noqa: BLE001 - told by `check`
            if is_of_arm(error):
                self.loss = f"the {self.name}: {explain(error)}"
            else:
                self._failure = error
        finally:
            del robot  # stops a motion that still runs, and disconnects
            self.ready.set()

    def _open(self) -> Any:
        franky = self.franky
        config = franky.RealtimeConfig
        realtime = config.Enforce if self.options.realtime == "enforce" else config.Ignore
        robot = franky.Robot(self.options.host, realtime_config=realtime)
        state = robot.state
        if state.robot_mode.name == "Reflex" or robot.has_errors:
            errors = str(state.current_errors)
            if not robot.recover_from_errors():
                raise ArmProblem(f"it cannot be recovered from {errors}: follow what Desk shows")
            LOG.warning("the %s was recovered from %s", self.name, errors)
            state = robot.state
        self._fresh_ns = time.monotonic_ns()
        self._take(state, self._fresh_ns)
        return robot

    def _turn(self, robot: Any) -> None:
        now_ns = time.monotonic_ns()
        self._due_ns = max(self._due_ns + _PERIOD_NS, now_ns)
        time.sleep((self._due_ns - now_ns) / 1e9)
        state = robot.state  # waits for the next state if nothing moves
        now_ns = time.monotonic_ns()
        if self.control is not None and self.control.step(robot, state, now_ns):
            self.control = None
        self._take(state, now_ns)
        self.turn_ns = now_ns
        self.turns += 1

    def _take(self, state: Any, now_ns: int) -> None:
        """Publish a state, unless it says that the arm cannot be used."""
        problem = OF_MODE.get(state.robot_mode.name)
        if problem is not None:
            raise ArmProblem(problem)
        x, y, z = state.O_T_EE.translation.tolist()
        u, v, w = state.O_F_ext_hat_K.tolist()[:3]  # force of the robot on what it touches
        time_ms = state.time.to_msec()
        if time_ms != self.state.time_ms:
            self._fresh_ns, self._silent = now_ns, 0
        else:
            self._silent += 1
            if self._silent > _SILENT_TURNS and now_ns - self._fresh_ns > _SILENT_NS:
                raise ArmProblem("it sends no new state: check its power and its cable")
        a, b, c, real = state.O_T_EE.quaternion.tolist()
        place_mm, force_n = (1e3 * x, 1e3 * y, 1e3 * z), (0.0 - u, 0.0 - v, 0.0 - w)
        self.state = ArmState(time_ms, place_mm, force_n, (real, a, b, c))

    def check(self) -> ArmState:
        """Return the newest state.

        Raises
        ------
        DeviceLost
            The arm is lost; `acquire_arm` connects it again.
        MmtError
            The driver itself failed.
        """
        if self._failure is not None:
            raise MmtError(f"the {self.name}: the driver failed: {self._failure!r}")
        if self.loss is not None:
            raise DeviceLost(self.loss)
        if time.monotonic_ns() - self.turn_ns > _STUCK_NS:
            raise DeviceLost(f"the {self.name} does not answer: check its power and its cable")
        return self.state

    def await_turn(self) -> None:
        """Return soon after the thread's next turn, or after 20 ms."""
        turns, deadline = self.turns, time.monotonic() + _TURN_S
        while self.turns == turns and time.monotonic() < deadline:
            time.sleep(_SHORT_S)

    def release(self) -> None:
        """Bring the arm to rest, and take no more commands."""
        control = self.control
        if control is not None:
            control.left = True
        deadline = time.monotonic() + _END_S
        while self.control is not None and self.is_alive() and time.monotonic() < deadline:
            time.sleep(0.001)

    def end(self) -> None:
        """Bring the arm to rest and disconnect it."""
        self.ended.set()
        self.release()
        self.join(_END_S)


_ARMS: Final[dict[str, FrankaArm]] = {}
_LOCK: Final = threading.Lock()


def acquire_arm(options: ArmOptions) -> FrankaArm:
    """Connect an arm, or share its connection; a lost connection is made anew.

    Raises
    ------
    InputError
        The drivers of one arm differ in `realtime`.
    MmtError
        The arm cannot be used; the message says why.
    """
    arm = _take_part(options, importlib.import_module("franky"))
    try:
        if arm.ready.wait(_CONNECT_S):
            arm.check()
            return arm
        problem = (
            f"the {arm.name} takes the connection but does not answer: check that the "
            "address is the robot's, and start the robot again"
        )
    except DeviceLost as error:
        problem = str(error)
    except BaseException:
        release_arm(arm)
        raise
    release_arm(arm)
    raise MmtError(problem)


def _take_part(options: ArmOptions, franky: Any) -> FrankaArm:
    """Add a user to the arm at this address; start the connection if there is none."""
    with _LOCK:
        arm = _ARMS.get(options.host)
        if arm is not None and (arm.loss is not None or arm.ended.is_set() or not arm.is_alive()):
            arm.join(_END_S)  # the robot takes one connection at a time
            arm = None
        if arm is None:
            arm = _ARMS[options.host] = FrankaArm(options, franky)
            arm.start()
            atexit.register(arm.end)
        elif arm.options.realtime != options.realtime:
            raise InputError(f"the drivers of the {arm.name} differ in 'realtime': give the same")
        arm.users += 1
        return arm


def release_arm(arm: FrankaArm) -> None:
    """Remove a user; the last one to leave disconnects the arm."""
    with _LOCK:
        arm.users -= 1
    if arm.ready.is_set() and _end_if_unused(arm):
        atexit.unregister(arm.end)
        arm.end()


def _end_if_unused(arm: FrankaArm) -> bool:
    """Set `ended` if all users have left, perhaps during connecting; return whether so."""
    with _LOCK:
        if arm.users == 0:
            arm.ended.set()
        return arm.users == 0
