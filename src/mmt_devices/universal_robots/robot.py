"""The follower's arm: an arm by Universal Robots that is sent to commanded positions."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.extras import require
from mmt.core.quaternions import Quaternion
from mmt.devices.discovery import lacking
from mmt_devices.universal_robots import dashboard
from mmt_devices.universal_robots.frame import M_TO_MM, SceneFrame
from mmt_devices.universal_robots.link import ArmLink
from mmt_devices.universal_robots.options import UrRobotOptions
from mmt_devices.universal_robots.servo import ServoSettings

missing = lacking(partial(require, "rtde_control"))


class UrRobot:
    """Implements `Robot`; see `docs/how-to/universal-robots.md`.

    Positions are those of the tool's centre point, which is set at the controller. The tool keeps
    the orientation that it has when the robot is connected.
    """

    OPTIONS = UrRobotOptions

    def __init__(self, options: UrRobotOptions) -> None:
        self._options = options
        require("rtde_control")
        normal = SceneFrame((0.0, 0.0, 0.0), options.rotation_rad).to_base((0.0, 0.0, 1.0))
        self._servo = ServoSettings(
            speed_m_s=options.speed_limit_mm_s / M_TO_MM,
            acceleration_m_s2=options.acceleration_limit_mm_s2 / M_TO_MM,
            force_limit_n=options.force_limit_n,
            normal=normal,
            lookahead_s=options.lookahead_s,
            gain=options.gain,
        )
        self._counts: Counter[str] = Counter()
        self._link: ArmLink | None = None
        self._frame: SceneFrame | None = None

    def connect(self) -> None:
        """Take control of the arm; it does not move until the first command.

        Raises
        ------
        InputError
            The force sensor of the same arm has its axes otherwise, or the arm has a driver.
        MmtError
            The arm does not answer, or takes no commands; the message says why.
        """
        self.close()
        host = self._options.host
        reason = dashboard.problem(host)
        if reason:
            raise MmtError(f"the arm at {host} {reason}")
        again = self._frame is not None
        link = ArmLink(self._options, self._servo, self._counts, again=again)
        link.start()
        self._link = link
        if self._frame is None:  # a new connection keeps the zero of the scene
            origin_mm = self._options.origin_mm
            if origin_mm is None:
                x, y, z = (M_TO_MM * part for part in link.read().position_m)
                origin_mm = (x, y, z)
            self._frame = SceneFrame(origin_mm, self._options.rotation_rad)

    def calibrate(self) -> None:
        """Do nothing: the arm is calibrated."""

    def read(self) -> Vector:
        """Return the tip's position (mm) of the newest cycle of the controller."""
        link, frame = self._connected()
        return frame.place_in_scene(link.read().position_m)

    def orientation(self) -> Quaternion:
        """Return the tool's orientation (w, x, y, z) of the newest cycle of the controller."""
        link, frame = self._connected()
        return frame.turn_in_scene(link.read().rotation_rad)

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return the newest positions (mm) that came between two times, the oldest first."""
        link, frame = self._connected()
        return [
            (state.time_ns, frame.place_in_scene(state.position_m))
            for state in link.kept
            if after_ns < state.time_ns < until_ns
        ]

    def write(self, position_mm: Vector) -> None:
        """Send the tip to a position (mm), cut to `least_mm` and `most_mm`.

        A position that is not finite is counted and ignored.
        """
        link, frame = self._connected()
        link.read()  # reports a loss even if the scene never reads the position
        if not all(map(math.isfinite, position_mm)):
            self._counts["commands that are not finite"] += 1
            return
        x, y, z = (
            min(max(part, least), most)
            for part, least, most in zip(
                position_mm, self._options.least_mm, self._options.most_mm, strict=True
            )
        )
        if (x, y, z) != tuple(position_mm):
            self._counts["commands outside of least_mm and most_mm"] += 1
        link.move(frame.place_in_base((x, y, z)))

    def close(self) -> None:
        """Stop the arm, end its program and disconnect; calling it twice is harmless."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of survived faults, by kind."""
        return dict(self._counts)

    def _connected(self) -> tuple[ArmLink, SceneFrame]:
        if self._link is None or self._frame is None:
            raise DeviceLost("the UR arm is not connected: connect it first")
        return self._link, self._frame
