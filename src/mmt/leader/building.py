"""Builders of the leader's parts: each imports its part and passes it the earlier ones needed."""

from typing import TYPE_CHECKING

from mmt.leader.part import Part, Parts, Session

if TYPE_CHECKING:
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
    """Make the scene's hand or handle."""
    from mmt.leader.motion.hand import HandPart

    parts.hand = HandPart.build(session)
    return parts.hand


def playout(session: Session, parts: LeaderParts) -> Part | None:
    """Make the streamed vibration."""
    from mmt.leader.output.stream import StreamedVibration

    parts.playout = StreamedVibration.build(session)
    return parts.playout


def motion(session: Session, parts: LeaderParts) -> Part | None:
    """Make the streamed motion, if no hand drives the scene's model."""
    if session.scene.commands:
        return None
    from mmt.leader.output.synthesis import StreamedMotion

    parts.motion = StreamedMotion.build(session)
    return parts.motion


def force_feedback(session: Session, parts: LeaderParts) -> Part | None:
    """Make the display of force."""
    from mmt.leader.motion.feedback_part import ForceFeedbackPart

    parts.force_feedback = ForceFeedbackPart.build(session, parts.hand, parts.other_force)
    return parts.force_feedback


def modelling(session: Session, parts: LeaderParts) -> Part | None:
    """Make the modelling."""
    from mmt.leader.modelling.pipeline import Modelling

    parts.modelling = Modelling.build(
        session,
        lambda update, seconds: parts.completing.update(update, seconds),  # noqa: PLW0108 - made later
        parts.modelling_process,
    )
    return parts.modelling


def synthesizing(session: Session, parts: LeaderParts) -> Part | None:
    """Make the part that renders from the model."""
    from mmt.leader.output.synthesis import SynthesizingPart

    parts.synthesizing = SynthesizingPart.build(session)
    return parts.synthesizing


def vibration(session: Session, parts: LeaderParts) -> Part | None:
    """Make the actuator and its switch."""
    from mmt.leader.output.vibration import VibrationPart

    parts.vibration = VibrationPart.build(
        session,
        parts.playout,
        parts.motion,
        None if parts.synthesizing is None else parts.synthesizing.synthesizer,
        None if parts.generating is None else parts.generating.vibration,
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
