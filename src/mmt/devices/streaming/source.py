"""Stream the measurements of real devices: a robot, a force sensor, an accelerometer."""

import logging
import math
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from mmt.core.arrays import RecordArray, Vector
from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.frames import (
    FIELD_OF_CHANNEL,
    FRAMES_HZ,
    Channel,
    frame_dtype,
    missing_band,
    ordered_channels,
)
from mmt.core.rotations import turn_into_scene
from mmt.core.sequence_numbers import SEQUENCES
from mmt.devices.protocols import (
    Accelerometer,
    ForceSensor,
    Pacing,
    Robot,
    SampledSensor,
    fault_explanation,
)
from mmt.devices.streaming.frame_assembly import FrameAssembler, ReadingAges
from mmt.devices.streaming.lanes import Lane, OrientationLane, PolledLane
from mmt.devices.streaming.polling import PhasePoller, Retry
from mmt.devices.streaming.slots import (
    PolledSlot,
    RobotSlot,
    SampledSlot,
    Slot,
    failure,
    named,
    slot_of,
)
from mmt.devices.streaming.vibration_lane import VibrationLane

if TYPE_CHECKING:
    from mmt.devices.streaming.tool_load import LoadRemover

LOG: Final = logging.getLogger("mmt.devices")

PERIOD_NS: Final = 1_000_000

_WARM_UP_NS: Final = 100_000_000
_FIRST_READINGS_NS: Final = 1_500_000_000
_KEY_OF_CHANNEL: Final[dict[Channel, str]] = {
    "position": "robot",
    "force": "force_sensor",
    "acceleration": "accelerometer",
    "orientation": "robot",
}

LossWatcher = Callable[[bool, str, bool], None]
"""Called with whether a device is lost now, a sentence, and whether that is about the robot."""
FrameReceiver = Callable[[RecordArray], None]
"""Called between two ticks with frames (n,), n >= 1."""


class DeviceSource:
    """A `FollowerSource` that reads devices at each tick; they may be lost and come back.

    If all devices are polled, each tick makes a frame. If one has a clock of its own, all are
    merged by their time stamps (`mmt.devices.streaming.lanes`). A tick without a measurement makes
    no frame: its sequence number is skipped, so that the leader sees a gap and no invented values.

    Parameters
    ----------
    robot
        Gives the position and takes the motion commands.
    force_sensor, accelerometer
        None if the scene's channels do not need the sensor.
    channels
        Channels of the frames.
    on_lost
        What a lost device does: "stop" ends the session; otherwise it is connected again, and
        the callback given to `on_loss` is called.
    samples_per_frame
        Samples of acceleration in a frame.
    tool
        Removes the load of the tool from the force; None to leave the force as measured.
    tool_axes
        Channels that are measured in the tool's axes; they are turned by the frame's orientation,
        after the load was removed.

    Raises
    ------
    InputError
        A channel has no device, frames need several samples of a polled accelerometer, the load
        of a tool is to be removed from frames without force or acceleration, or the robot does
        not measure the orientation that frames need.
    """

    def __init__(
        self,
        robot: Robot,
        force_sensor: ForceSensor | SampledSensor | None,
        accelerometer: Accelerometer | SampledSensor | None,
        channels: Iterable[Channel],
        *,
        on_lost: Literal["stop", "hold", "retract"] = "stop",
        samples_per_frame: int = 1,
        tool: "LoadRemover | None" = None,
        tool_axes: Iterable[Channel] = (),
    ) -> None:
        self._channels = ordered_channels(channels)
        if tool is not None and not {"force", "acceleration"} <= set(self._channels):
            raise InputError(
                "[devices] tool: its load is removed by the acceleration, so the scene must need "
                f"force and acceleration; its parts need {', '.join(self._channels)}"
            )
        self._tool = tool
        self._turned = tuple(channel for channel in tool_axes if channel in self._channels)
        self._acceleration_hz = samples_per_frame * FRAMES_HZ
        self._on_lost = on_lost
        self._watcher: LossWatcher = lambda _lost, _sentence, _of_robot: None
        self._taker: FrameReceiver | None = None
        robot_slot = RobotSlot(
            "robot",
            robot,
            measures="position" in self._channels,
            turns="orientation" in self._channels,
        )
        self._all: dict[str, Slot] = {"robot": robot_slot}
        if force_sensor is not None:
            self._all["force_sensor"] = slot_of("force sensor", force_sensor)
        if accelerometer is not None:
            lane = VibrationLane(samples_per_frame=samples_per_frame)
            self._all["accelerometer"] = slot_of("accelerometer", accelerometer, lane)
        for channel in self._channels:
            if (key := _KEY_OF_CHANNEL[channel]) not in self._all:
                raise InputError(f"[devices] has no {key}, but the scene needs {channel}")
        self._measuring = {
            FIELD_OF_CHANNEL[channel]: self._all[_KEY_OF_CHANNEL[channel]]
            for channel in self._channels
        }
        self._lanes: dict[str, Lane] = {
            field: robot_slot.orientation if field == "orientation" else slot.lane
            for field, slot in self._measuring.items()
        }
        if samples_per_frame > 1:
            acceleration = self._measuring.get(FIELD_OF_CHANNEL["acceleration"])
            _check_sampled(acceleration, self._acceleration_hz)
        self._stepped = list(dict.fromkeys([robot_slot, *self._measuring.values()]))
        self._sampled = [slot for slot in self._stepped if isinstance(slot, SampledSlot)]
        self._looked_at = [slot for slot in self._sampled if slot.stamping is None]
        self._opened = False
        self._lost: list[Slot] = []
        self._probed: tuple[Slot, Exception] | None = None
        self._dtype = frame_dtype(self._channels, samples_per_frame)
        self._sequence = 0
        self._merger = self._make_merger()
        self._prober = PhasePoller(self.probe, PERIOD_NS)
        self._retry = Retry(self.retry)

    def _make_merger(self, needed_ns: int | None = None) -> FrameAssembler | None:
        if not self._sampled:
            return None
        return FrameAssembler(self._lanes, self._dtype, PERIOD_NS, needed_ns)

    def on_loss(self, callback: LossWatcher) -> None:
        """Set the function to call when a device is lost and when it is back."""
        self._watcher = callback

    def on_late_frames(self, callback: FrameReceiver) -> None:
        """Set the function that is given the frames whose last reading came between two ticks."""
        self._taker = callback

    def open(self) -> None:
        """Connect and calibrate the devices, and learn the clocks of the sensors that have one.

        That can take seconds, and may run in a thread.

        Raises
        ------
        MmtError
            A device does not answer.
        """
        self._opened = True
        for opened in self._all.values():
            with named(opened):
                opened.device.connect()
                opened.device.calibrate()
        if self._tool is not None:
            accelerometer: Any = self._all["accelerometer"]
            with named(accelerometer):
                self._tool.learn_rest(accelerometer.device)
        for slot in self._sampled:  # a driver may know it only now, from the device's filter
            with named(slot):
                slot.lane.latency_ns = round(slot.device.latency_ns)
        if self._sampled:
            self._merger = self._make_merger(self._warm_up())
            self._tell_band()

    def start(self, start_time_ns: int) -> None:  # noqa: ARG002 - devices keep their own time
        """Begin to look for readings between the ticks; open the devices unless that was done.

        Raises
        ------
        MmtError
            A device does not answer.
        """
        if not self._opened:
            self.open()
        if self._looked_at:
            self._prober.start()
        if self._sampled and self._taker is not None:
            self._retry.start()
        for slot in self._all.values():
            if isinstance(slot.device, Pacing):  # so that later ticks do not meet its turns
                with named(slot):
                    slot.device.await_turn()

    def _warm_up(self) -> int | None:
        """Read often for a moment: the quickest arrivals show the difference of the clocks.

        Returns
        -------
        needed_ns
            How long frames must be held back; None if that is not known.
        """
        ages = ReadingAges(slot.lane for slot in self._sampled)
        start_ns = time.monotonic_ns()
        while (passed_ns := time.monotonic_ns() - start_ns) < _WARM_UP_NS or (
            passed_ns <= _FIRST_READINGS_NS
            and not all(slot.lane.period_ns for slot in self._sampled)
        ):
            for slot in self._sampled:
                with named(slot):
                    slot.poll()
            ages.record(time.monotonic_ns())
            time.sleep(5e-5)
        for slot in self._sampled:
            if not slot.lane.clock.known:
                why = (
                    fault_explanation(slot.device)
                    or "it gives no reading; check its cable and settings"
                )
                raise failure(slot, DeviceLost(why))
            slot.begin(time.monotonic_ns())
        return ages.hold_back_ns()

    def _tell_band(self) -> None:
        """Warn if the sensor's band of acceleration is smaller than the frames can hold."""
        slot = self._measuring.get(FIELD_OF_CHANNEL["acceleration"])
        if slot is not None and slot.lane.period_ns and self._acceleration_hz > FRAMES_HZ:
            remark = missing_band(1e9 / slot.lane.period_ns, self._acceleration_hz)
            if remark:
                LOG.warning("the accelerometer %s", remark)
            band_hz = getattr(slot.device, "band_hz", math.inf)
            if 2.0 * band_hz < self._acceleration_hz:
                LOG.warning(
                    "the accelerometer passes what is below %.0f Hz, the scene takes it to %.0f Hz",
                    band_hz,
                    0.5 * self._acceleration_hz,
                )

    def probe(self, now_ns: int) -> None:  # noqa: ARG002 - each read tells its own time
        """Read sampled sensors between two ticks; an error is raised at the next tick."""
        self._look(self._looked_at)

    def _look(self, slots: Iterable[SampledSlot]) -> None:
        for slot in slots:
            if slot.lost_ns is None and self._probed is None:
                try:
                    slot.poll()
                except Exception as error:  # noqa: BLE001 - raised by the next step
                    self._probed = (slot, error)

    def retry(self, now_ns: int) -> bool:  # noqa: ARG002 - as above
        """Look for readings that the last tick lacked; return whether any are still lacking."""
        merger, taker = self._merger, self._taker
        if merger is None or taker is None or not merger.lacking:
            return False
        self._look(self._sampled)
        frames = self._corrected(merger.frames())
        if len(frames):
            taker(frames)
        return merger.lacking and self._probed is None

    def step(self, elapsed: int, now_ns: int, command_position_mm: Vector | None) -> RecordArray:
        """Command the robot and read every device; see `FollowerSource`.

        Raises
        ------
        MmtError
            A device fails; the message says which.
        """
        self._sequence += elapsed
        probed, self._probed = self._probed, None
        for slot in self._stepped:
            try:
                if probed is not None and probed[0] is slot:
                    raise probed[1]  # noqa: TRY301 - as if it had come up now
                if slot.lost_ns is None:
                    slot.step(now_ns, command_position_mm)
                elif slot.reconnect(now_ns):
                    self._lost.remove(slot)
                    self._tell(slot, "is back")
                elif reason := slot.new_reason():
                    self._tell(slot, f"is not back yet: {reason}")
            except DeviceLost as error:
                self._lose(slot, error, now_ns)
            except Exception as error:
                raise failure(slot, error) from error
        if self._merger is not None:
            self._merger.tick(elapsed, now_ns)
            if self._lost:
                self._merger.give_up()
            frames = self._merger.frames()
            self._retry.tick(lacking=self._merger.lacking)
            return self._corrected(frames)
        return self._corrected(self._polled_frame(now_ns))

    def _corrected(self, frames: RecordArray) -> RecordArray:
        """Return the frames without the load of the tool, and in the scene's axes."""
        if self._tool is not None and len(frames):
            self._tool.remove(frames)
        if self._turned and len(frames):
            turn_into_scene(frames, self._turned)
        return frames

    def _polled_frame(self, now_ns: int) -> RecordArray:
        if self._lost:
            return np.empty(0, dtype=self._dtype)
        frames = np.zeros(1, dtype=self._dtype)
        frames["sequence"] = (self._sequence - 1) % SEQUENCES
        frames["time_ns"] = now_ns
        for field, lane in self._lanes.items():
            assert isinstance(lane, PolledLane | OrientationLane)  # noqa: S101 - none is sampled
            if lane.last is None:
                return frames[:0]
            frames[field][0] = lane.last
        return frames

    def _lose(self, slot: Slot, error: DeviceLost, now_ns: int) -> None:
        if self._on_lost == "stop":
            raise failure(slot, error) from error
        self._lost.append(slot)
        slot.lose(now_ns, str(error))
        self._tell(slot, f"is lost: {error}")

    def _tell(self, slot: Slot, what: str) -> None:
        self._watcher(bool(self._lost), f"{slot.name} {what}", slot is self._all["robot"])

    @property
    def finished(self) -> bool:
        """False: devices go on until they are closed."""
        return False

    @property
    def annotations(self) -> bytes:
        """Empty: no truth is known besides the measurements."""
        return b""

    @property
    def summary(self) -> dict[str, Any]:
        """Summary of each device, for a program."""
        return {key: slot.summary for key, slot in self._all.items()}

    def describe(self) -> str:
        """Return the names of the devices."""
        return "devices: " + ", ".join(slot.describe() for slot in self._all.values())

    def close(self) -> None:
        """Close every device, even if closing one of them fails.

        Raises
        ------
        MmtError
            One or more could not be closed.
        """
        self._prober.stop()
        self._retry.stop()
        problems = []
        for slot in self._all.values():
            try:
                slot.close()
            except Exception as error:  # noqa: BLE001 - the others must still be closed
                problems.append(str(failure(slot, error)))
        if problems:
            raise MmtError("; ".join(problems))


def _check_sampled(slot: Slot | None, acceleration_hz: int) -> None:
    """Raise `InputError` if the sensor is polled: it cannot give several samples a frame."""
    if isinstance(slot, PolledSlot):
        from mmt.devices.discovery import find_drivers

        rates = [
            f"{driver.name} ({driver.rates})"
            for driver in find_drivers()
            if driver.rates and "accelerometer" in driver.roles
        ]
        raise InputError(
            f"{slot.name} is asked once a millisecond and gives 1000 samples a second, where the "
            f"scene takes {acceleration_hz} ([session] acceleration_rate_hz): leave that out, or "
            f"take a sensor with a clock of its own: {'; '.join(rates)}"
        )
