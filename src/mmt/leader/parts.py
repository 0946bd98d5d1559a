"""Build the parts that a scene asks for; a part that is absent is not even imported."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from mmt.core.arrays import RecordArray
from mmt.core.errors import MmtError
from mmt.devices.protocols import LeaderInterface, VibrationActuator
from mmt.leader.concealment import build_concealment
from mmt.leader.feedback import Feedback
from mmt.leader.feedback_choice import build_feedback
from mmt.leader.playout import PlayoutBuffer
from mmt.leader.rendering import VibrationSwitch
from mmt.leader.stream import StreamedMotion, StreamedVibration
from mmt.scene import Actuator, Handle, Link, Rendering, Scene, Simulated, Texture

if TYPE_CHECKING:
    from mmt.devices.reconnection import LossCallback, ReconnectingActuator, ReconnectingDevice
    from mmt.leader.handle import OperatorHandle
    from mmt.leader.model_crossfade import ModelCrossfade
    from mmt.leader.modelling import Modelling
    from mmt.leader.warming import WarmingTask
    from mmt.session.recorder import McapRecorder
    from mmt.texture.online.work import ModelUpdate
    from mmt.texture.synthesis.synthesizer import Synthesizer
    from mmt.web.monitor.tap import MonitorTap


@dataclass
class LeaderParts:
    """The leader's parts; None where the scene leaves one out."""

    hand: "LeaderInterface | OperatorHandle | None" = None
    handle: "OperatorHandle | None" = None
    """The hand, where it is a driver's handle that may be lost and come back."""
    actuator: VibrationActuator | None = None
    mended: "ReconnectingActuator | None" = None
    """The actuator, where it is a driver's, which may be lost and come back."""
    playout: PlayoutBuffer | None = None
    streamed_vibration: StreamedVibration | None = None
    streamed_motion: StreamedMotion | None = None
    tangential: tuple[int, int] = (0, 1)
    """The axes of the surface: those other than its normal."""
    feedback: Feedback | None = None
    modelling: "Modelling | None" = None
    warming: "WarmingTask | None" = None
    synthesizer: "Synthesizer | ModelCrossfade | None" = None
    crossfade: "ModelCrossfade | None" = None
    """The synthesizer, where it goes from one surface's model to another's."""
    switch: VibrationSwitch | None = None
    make_recorder: "Callable[..., McapRecorder] | None" = None
    recorder: "McapRecorder | None" = None
    ended_recorder: "McapRecorder | None" = None
    """The last one that was ended before the session."""
    tap: "MonitorTap | None" = None
    """Takes what the monitor shows."""

    def connect(self) -> None:
        """Open the devices.

        Raises
        ------
        MmtError
            One of them does not answer.
        """
        for device in (self.hand, self.actuator):
            if device is None:
                continue
            try:
                device.connect()
                device.calibrate()
            except MmtError:
                raise
            except Exception as error:
                name, reason = self._name(device), str(error) or type(error).__name__
                raise MmtError(f"{name} cannot be connected: {reason}") from error

    def begin_recording(self, session_id: str) -> None:
        """Make the recording's file, which replaces an older one of that name.

        Call it when nothing else can keep the session from starting.

        Raises
        ------
        InputError
            The file cannot be made.
        """
        if self.make_recorder is not None:
            self.recorder = self.make_recorder(session_id=session_id)

    def take(self, frames: RecordArray, arrival_ns: int) -> None:
        """Hand the newest frames (n,) to every part that uses them."""
        if self.recorder is not None:
            self.recorder.record_frames(frames)
        if self.streamed_vibration is not None:
            self.streamed_vibration.take(frames, arrival_ns)
        if self.streamed_motion is not None:
            self.streamed_motion.take(frames)
        if self.feedback is not None:
            self.feedback.take(frames)
        if self.modelling is not None:
            self.modelling.put(frames)
        if self.warming is not None:
            self.warming.take(frames)
        if self.tap is not None:
            self.tap.take(frames)

    def close(self) -> list[str]:
        """Release the devices and finish the recording, also when one of them fails.

        Returns
        -------
        problems
            A sentence for each device that could not be released.
        """
        problems = []
        for device in (self.hand, self.actuator):
            try:
                if device is not None:
                    device.close()
            except Exception as error:  # noqa: BLE001 - the rest must still be closed
                problems.append(f"closing {self._name(device)}: {error}")
        if self.modelling is not None:
            self.modelling.close()
        if self.recorder is not None:
            self.recorder.close()
        return problems

    @property
    def may_be_lost(self) -> "list[ReconnectingDevice[Any]]":
        """The devices without which the session goes on."""
        return [device for device in (self.handle, self.mended) if device is not None]

    def watch(self, callback: "LossCallback") -> None:
        """Have a function told of devices that are lost and of their return."""
        for device in self.may_be_lost:
            device.watch(callback)

    def _name(self, device: object) -> str:
        return next(
            (mended.name for mended in self.may_be_lost if mended is device),
            type(device).__name__,
        )


def build_parts(scene: Scene, on_update: Callable[["ModelUpdate", float], None]) -> LeaderParts:
    """Import, compile and assemble what the scene needs.

    Raises
    ------
    InputError
        A file that the scene names cannot be used.
    MmtError
        A device does not answer.
    """
    parts = LeaderParts()
    rate_hz = float(scene.session.rate_hz)
    geometry = scene.texture or Texture()
    first, second = (axis for axis, name in enumerate("xyz") if name != geometry.normal)
    parts.tangential = first, second
    if scene.hand is not None:
        from mmt.testing.simulation.hand import SimulatedHand
        from mmt.testing.simulation.robot import nominal_compliance_mm_n

        parts.hand = SimulatedHand(
            scene.hand,
            scene.session.seed,
            compliance_mm_n=nominal_compliance_mm_n(scene.simulated or Simulated()),
        )
    elif scene.handle is not None:
        _build_handle(scene, scene.handle, parts)
    if scene.texture is not None:
        from mmt.leader.modelling import Modelling

        parts.modelling = Modelling(
            scene.texture.settings(rate_hz),
            scene.texture.update_period_s,
            on_update,
            keep_frames=scene.keep_frames(),
        )
    _build_streamed(scene, parts)
    if scene.force_feedback is not None and parts.hand is not None:
        parts.feedback = build_feedback(
            scene.force_feedback, parts.hand, rate_hz=rate_hz, normal=geometry.normal
        )
    if scene.actuator is not None:
        _build_vibration(scene, parts)
    if scene.recording is not None:
        from mmt.session.recorder import McapRecorder

        parts.make_recorder = partial(
            McapRecorder, scene.recording.file, channels=scene.channels(), scene=scene.dump()
        )
    return parts


def _build_handle(scene: Scene, table: Handle, parts: LeaderParts) -> None:
    from mmt.devices.drivers import load_device

    device: LeaderInterface = load_device(table.driver, table.options, role="handle")
    if table.on_lost == "stop":
        parts.hand = device
        return
    from mmt.leader.handle import OperatorHandle

    link = scene.link or Link()
    parts.hand = parts.handle = OperatorHandle(device, link.recovery_mm_s / scene.session.rate_hz)


def _make_actuator(table: Actuator, parts: LeaderParts) -> VibrationActuator:
    if table.driver is None:
        from mmt.testing.simulation.actuator import SimulatedActuator

        return SimulatedActuator(limit_m_s2=table.limit_m_s2)
    from mmt.devices.drivers import load_device
    from mmt.devices.reconnection import ReconnectingActuator

    parts.mended = ReconnectingActuator(load_device(table.driver, table.options, role="actuator"))
    return parts.mended


def _build_streamed(scene: Scene, parts: LeaderParts) -> None:
    """Build what takes vibration and motion from the frames at once."""
    geometry = scene.texture or Texture()
    rate_hz = float(scene.session.rate_hz)
    if scene.playout is not None and scene.streams:
        parts.playout = PlayoutBuffer(
            scene.playout.delay_ms,
            scene.playout.longest_delay_ms,
            round(1e9 / rate_hz),
            build_concealment(scene.concealment, scene.session.seed),
        )
        parts.streamed_vibration = StreamedVibration(
            parts.playout, geometry.axis, geometry.normal, rate_hz
        )
    if scene.rendering is not None and not scene.commands:
        parts.streamed_motion = StreamedMotion(geometry.normal, rate_hz)


def _build_vibration(scene: Scene, parts: LeaderParts) -> None:
    assert scene.actuator is not None  # noqa: S101 - the caller has looked
    limit_m_s2 = scene.actuator.limit_m_s2
    parts.actuator = _make_actuator(scene.actuator, parts)
    crossfade_ms = 0.0
    if scene.rendering is not None:
        crossfade_ms = scene.rendering.crossfade_ms
        _build_synthesizer(scene, scene.rendering, limit_m_s2, parts)
        if scene.rendering.before == "warm" and scene.texture is not None:
            from mmt.leader.warming import WarmingTask, load_library

            parts.warming = WarmingTask(
                load_library(scene.rendering.library),
                scene.texture.settings(float(scene.session.rate_hz)),
            )
    parts.switch = VibrationSwitch(
        parts.playout.pull if parts.playout is not None else None,
        parts.synthesizer,
        crossfade_samples=_samples(scene, crossfade_ms),
        limit_m_s2=limit_m_s2,
        period_ns=round(1e9 / scene.session.rate_hz),
    )
    if parts.synthesizer is not None and parts.synthesizer.model is not None:
        parts.switch.use_model(True)


def _build_synthesizer(
    scene: Scene, table: Rendering, limit_m_s2: float, parts: LeaderParts
) -> None:
    from mmt.texture.synthesis.synthesizer import Synthesizer

    def made(seed: int) -> Synthesizer:
        return Synthesizer(seed=seed, renewal_samples=table.renewal_samples, limit_m_s2=limit_m_s2)

    parts.synthesizer = first = made(scene.session.seed)
    if table.model is not None:
        from mmt.models import find_model
        from mmt.texture.model.texture_model import TextureModel

        first.model = TextureModel.load(find_model(table.model))
    if scene.texture is not None and scene.texture.surfaces is not None:
        from mmt.leader.model_crossfade import ModelCrossfade

        samples = _samples(scene, table.crossfade_ms)
        second = made(scene.session.seed + 1)
        parts.synthesizer = parts.crossfade = ModelCrossfade(
            first, second, crossfade_samples=samples
        )


def _samples(scene: Scene, duration_ms: float) -> int:
    return round(duration_ms * scene.session.rate_hz / 1000)
