"""Builders of the leader's parts, by the scene: each imports its part, and passes it what it needs.

A builder returns None for a part that is not needed. It raises an `InputError` if a file or a
driver that the scene names cannot be used.
"""

import math
from functools import partial
from typing import TYPE_CHECKING

from mmt.core.guards import GuardedDisplay, VibrationSlew
from mmt.leader.part import Part, Parts, Session
from mmt.scene import Link, Simulated, Texture

if TYPE_CHECKING:
    from mmt.devices.protocols import LeaderInterface
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.modelling.process import ModellingProcess
    from mmt.leader.monitoring.part import MonitorPart
    from mmt.leader.motion.feedback_part import ForceFeedbackPart, OtherForce
    from mmt.leader.motion.hand import HandPart
    from mmt.leader.output.model_output import ModelOutput, OtherGenerator
    from mmt.leader.output.stream import StreamedVibration
    from mmt.leader.output.synthesis import StreamedMotion, SynthesizingPart
    from mmt.leader.output.vibration import VibrationPart
    from mmt.leader.recording import RecordingPart


class LeaderParts(Parts):
    """The parts of a leader, with names for those that others need; None if left out."""

    recording: "RecordingPart | None" = None
    hand: "HandPart | None" = None
    playout: "StreamedVibration | None" = None
    motion: "StreamedMotion | None" = None
    other_force: "OtherForce | None" = None
    """Set by another package's part."""
    force_feedback: "ForceFeedbackPart | None" = None
    modelling_process: "ModellingProcess | None" = None
    """Set if the process was launched before."""
    modelling: "Modelling | None" = None
    synthesizing: "SynthesizingPart | None" = None
    generating: "OtherGenerator | None" = None
    """Set by another package's part."""
    vibration: "VibrationPart | None" = None
    completing: "ModelOutput"
    """Every leader has this part."""
    monitor: "MonitorPart | None" = None


def recording(session: Session, parts: LeaderParts) -> Part:
    """Make the part that records."""
    from mmt.leader.recording import RecordingPart

    parts.recording = RecordingPart(session)
    return parts.recording


def hand(session: Session, parts: LeaderParts) -> Part | None:
    """Make the scene's hand, real or simulated."""
    from mmt.leader.motion.hand import HandPart

    scene = session.scene
    if scene.hand is not None:
        from mmt.testing.simulation import nominal_compliance_mm_n
        from mmt.testing.simulation.hand import SimulatedHand

        compliance_mm_n = nominal_compliance_mm_n(scene.simulated or Simulated())
        simulated = SimulatedHand(scene.hand, scene.session.seed, compliance_mm_n=compliance_mm_n)
        parts.hand = HandPart(session, simulated)
    elif (table := scene.handle) is not None:
        from mmt.devices.drivers import load_device

        device: LeaderInterface = load_device(table.driver, table.options, role="handle")
        contact = handle = None
        if table.hand_force == "contact":
            from mmt.leader.motion.hand_contact import FollowerContact

            contact = FollowerContact(session, table.surface_stiffness_n_mm)
        if table.on_lost != "stop":
            from mmt.devices.reconnection import OperatorHandle

            recovery_mm_s = (scene.link or Link()).recovery_mm_s
            handle = OperatorHandle(device, recovery_mm_s / scene.session.rate_hz)
        parts.hand = HandPart(session, handle or device, handle, contact)
    return parts.hand


def playout(session: Session, parts: LeaderParts) -> Part | None:
    """Make the streamed vibration."""
    from mmt.leader.output.concealment import build_concealment
    from mmt.leader.output.stream import PlayoutBuffer, StreamedVibration

    scene, table = session.scene, session.scene.playout
    if table is None:
        return None
    buffer = PlayoutBuffer(
        table.delay_ms,
        table.longest_delay_ms,
        session.period_ns,
        build_concealment(scene.concealment, scene.session.seed, session.samples_per_frame),
    )
    axis = (scene.texture or Texture()).axis
    parts.playout = StreamedVibration(
        buffer, axis, session.rate_hz, session.samples_per_frame, session
    )
    return parts.playout


def motion(session: Session, parts: LeaderParts) -> Part | None:
    """Make the streamed motion, if no hand drives the scene's model."""
    scene = session.scene
    if scene.commands:
        return None
    from mmt.leader.output.synthesis import StreamedMotion

    limit_mm_s = (scene.link or Link()).limit_mm_s
    parts.motion = StreamedMotion(scene.normal, session.rate_hz, limit_mm_s)
    return parts.motion


def force_feedback(session: Session, parts: LeaderParts) -> Part | None:
    """Make the display of force by the scene's method, if there is a hand to display to."""
    from mmt.leader.motion.feedback_part import ForceFeedbackPart, build_feedback, model_settings

    scene, table, hand = session.scene, session.scene.force_feedback, parts.hand
    if table is None or hand is None:
        return None
    step_n = math.inf if table.slew_n_s == "off" else table.slew_n_s / session.rate_hz
    display = GuardedDisplay(hand.device, table.limit_n, step_n)
    if parts.other_force is not None:
        settings = model_settings(table, 1.0 / session.rate_hz, scene.normal)
        shown = parts.other_force(display, limit_n=table.limit_n, settings=settings)
    else:
        contact = None if hand.contact is None else hand.contact.model
        shown = build_feedback(
            table, display, rate_hz=session.rate_hz, normal=scene.normal, contact=contact
        )
    parts.force_feedback = ForceFeedbackPart(session, shown, display)
    return parts.force_feedback


def modelling(session: Session, parts: LeaderParts) -> Part | None:
    """Make the modelling of the scene's texture, with a new process if there is none."""
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.modelling.process import ModellingProcess

    replay = session.scene.replay
    process = parts.modelling_process or ModellingProcess.from_scene(session.scene)
    if process is None:
        return None
    if process.factory.sequential and replay is not None:
        from mmt.leader.surface_log import replayed_words

        process.notify("begin", replayed_words(replay))
    parts.modelling = Modelling(session, process)
    return parts.modelling


def synthesizing(session: Session, parts: LeaderParts) -> Part | None:
    """Make the part that renders from the model, with the scene's saved model if it names one."""
    scene, table, actuator = session.scene, session.scene.rendering, session.scene.actuator
    if table is None or actuator is None:
        return None
    from mmt.leader.output.synthesis import SynthesizingPart, at_session_rate
    from mmt.texture.synthesis.synthesizer import Synthesizer

    made = partial(
        Synthesizer, renewal_samples=table.renewal_samples, limit_m_s2=actuator.limit_m_s2
    )
    first, crossfade, rate_remark = made(seed=scene.session.seed), None, ""
    if table.model is not None:
        from mmt.models import find_model
        from mmt.texture.model.texture_model import TextureModel

        saved = TextureModel.load(find_model(table.model))
        first.model, rate_remark = at_session_rate(saved, session.acceleration_rate_hz)
    several = scene.texture is not None and scene.texture.surfaces is not None
    if several or scene.is_given("model"):
        from mmt.leader.output.renderer import ModelCrossfade

        samples = round(table.crossfade_ms * session.acceleration_rate_hz / 1000)
        second = made(seed=scene.session.seed + 1)
        crossfade = ModelCrossfade(first, second, crossfade_samples=samples)
    parts.synthesizing = SynthesizingPart(crossfade or first, crossfade, rate_remark)
    return parts.synthesizing


def vibration(session: Session, parts: LeaderParts) -> Part | None:
    """Make the actuator, its switch and its bounds."""
    from mmt.leader.output.vibration import VibrationPart, VibrationSwitch, build_actuator

    table, rendering = session.scene.actuator, session.scene.rendering
    if table is None:
        return None
    rate_hz, generating = session.acceleration_rate_hz, parts.generating
    renderer = None if parts.synthesizing is None else parts.synthesizing.synthesizer
    actuator, reconnecting = build_actuator(table, rate_hz)
    crossfade_ms = 0.0 if rendering is None else rendering.crossfade_ms
    switch = VibrationSwitch(
        None if parts.playout is None else parts.playout.buffer.pull,
        renderer if generating is None else generating.vibration,
        crossfade_samples=round(crossfade_ms * rate_hz / 1000),
        period_ns=session.period_ns,
        samples_per_tick=session.samples_per_frame,
    )
    if renderer is not None and renderer.model is not None:
        switch.use_model(True)
    step = math.inf if table.slew_m_s3 == "off" else table.slew_m_s3 / rate_hz
    slew = VibrationSlew(table.limit_m_s2, step, session.samples_per_frame)
    landing = None
    if renderer is not None and generating is None:
        from mmt.leader.output.synthesis import Landing
        from mmt.texture.touch_down import LEAST_RATE_HZ

        if rate_hz >= LEAST_RATE_HZ:
            landing = Landing("xyz".index(session.scene.normal), session.rate_hz)
    parts.vibration = VibrationPart(
        session, actuator, switch, slew, reconnecting, parts.motion, landing
    )
    return parts.vibration


def completing(session: Session, parts: LeaderParts) -> Part:
    """Make the part that puts models to use."""
    from mmt.leader.output.model_output import ModelOutput

    parts.completing = ModelOutput(
        session,
        parts.recording,
        parts.modelling,
        parts.synthesizing,
        parts.generating,
        parts.vibration,
    )
    return parts.completing


def metrics(session: Session, _: LeaderParts) -> Part:
    """Make the part that serves metrics."""
    from mmt.leader.metrics import MetricsPart

    return MetricsPart(session)


def monitor(session: Session, parts: LeaderParts) -> Part | None:
    """Make the live page."""
    from mmt.leader.monitoring.controls import Controls
    from mmt.leader.monitoring.part import MonitorPart

    table, recording = session.scene.monitor, parts.recording
    if table is None or recording is None:
        return None
    controls = Controls(session, parts.completing, recording, parts.modelling)
    parts.monitor = MonitorPart(
        session, table, controls, playout=parts.playout, vibration=parts.vibration
    )
    return parts.monitor
