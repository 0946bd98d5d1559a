"""The part that puts each new model to use, and switches the output to it."""

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, Protocol

from mmt.core.errors import InputError
from mmt.leader.part import Part, Session
from mmt.texture.signals.aligned import SignalFaults

if TYPE_CHECKING:
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.output.renderer import SynthesizedVibration
    from mmt.leader.output.synthesis import SynthesizingPart
    from mmt.leader.output.vibration import VibrationPart
    from mmt.leader.recording import RecordingPart
    from mmt.session.recorder import McapRecorder
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.updates import ModelUpdate


class OtherGenerator(Protocol):
    """Renders by another method, in place of the model."""

    @property
    def vibration(self) -> "SynthesizedVibration":
        """Vibration from the generator."""

    def start_rendering(self) -> None:
        """Start to render: the start criterion is met."""

    def reset(self) -> None:
        """Start anew."""


class ModelOutput(Part):
    """Render from each new model, record and announce it; switch the output by the criteria.

    Parameters
    ----------
    session
        Session of the run.
    recording
        Gets the models and events, while it records.
    modelling
        Makes the models.
    synthesizing
        Renders from the models.
    generating
        Another method's generator, which renders instead.
    vibration
        Plays the rendered vibration, or the stream.
    """

    def __init__(
        self,
        session: Session,
        recording: "RecordingPart | None" = None,
        modelling: "Modelling | None" = None,
        synthesizing: "SynthesizingPart | None" = None,
        generating: "OtherGenerator | None" = None,
        vibration: "VibrationPart | None" = None,
    ) -> None:
        self._session = session
        self._log = session.log
        self._event = session.journal.event
        self._said = SignalFaults()
        self._new_faults = SignalFaults()  # of the newest update
        self._reported_rate = ""  # of the newest shared model
        self.fell = ""
        """Why the expected share has fallen with the newest update, "" if it has not."""
        self.played_share: float | None = None
        """Share of the model's power that the actuator plays, as last told; None before."""
        self._rendered: int | None = None  # the surface whose model is rendered
        self._recorded: dict[int, TextureModel] = {}  # by surface, in this recorder:
        self._recorder: McapRecorder | None = None
        self._recording, self._modelling = recording, modelling
        self._synthesizing, self._generating = synthesizing, generating
        self._vibration = vibration
        if recording is not None:
            recording.before_end = self.record_last
        if modelling is not None:
            modelling.deliver = self.update
        self.takes_over = self.rendered is not None
        """Whether the model is good enough to be rendered, whatever a person has fixed."""
        self.forced: Literal["streamed", "synthesized"] | None = None
        """Vibration that a person has fixed, or None if the criterion decides."""

    @property
    def rendered(self) -> "TextureModel | None":
        """The synthesizer's model, played or not; None if there is none."""
        return None if self._synthesizing is None else self._synthesizing.synthesizer.model

    @property
    def renders(self) -> bool:
        """Whether vibration can be rendered from a model."""
        return self._synthesizing is not None

    @property
    def newest(self) -> "TextureModel | None":
        """The model that is rendered, or else the one that grows."""
        if self.takes_over and self.rendered is not None:
            return self.rendered
        return None if self._log.update is None else self._log.update.model

    def begin(self) -> None:
        """Report if a saved model has another rate, and how much of it the actuator plays."""
        if self._synthesizing is not None and self._synthesizing.rate_remark:
            self._event(self._synthesizing.rate_remark)
        self._tell_of_skin(self.rendered)

    def faults(self) -> list[str]:
        """Return the faults of the newest signals; the link reports missing frames."""
        modelling = self._modelling
        if modelling is None or modelling.finished or modelling.frozen:
            return []
        found = self._new_faults.sentence()
        return [found] if found else []

    def close(self) -> None:
        """Record the last models, and save that of each surface beside the recording."""
        self.record_last()
        for problem in self.save_surfaces():
            self._session.journal.say(problem)

    def update(self, update: "ModelUpdate", seconds: float) -> None:
        """Put an update of the model to use; `seconds` is the time that the update took.

        Vibration is rendered from the new model once the start criterion is met; until then
        from the saved model, if the scene names one.
        """
        log = self._log
        since_s = 0.0 if self._modelling is None else self._modelling.since_s
        update = replace(update, time_s=since_s + update.time_s)
        before = log.update
        self._new_faults = update.faults.since(before.faults if before else SignalFaults())
        self._say_fall(update, before)
        log.update = update
        log.update_times.add(round(1e9 * seconds))
        if update.faults.should_report(self._said):
            self._said = update.faults
            self._event(f"not measured: {update.faults.sentence()}", faults=update.faults.as_dict())
        usable = update.started and update.model is not None
        if update.surface is not None:
            self._follow_surface(update, since_s, usable=usable)
        if update.model is not None and (usable or self.forced == "synthesized"):
            self._render(update.model, update.surface)
        if usable and self._generating is not None:
            self._generating.start_rendering()
        if usable and log.start_s is None:
            log.start_s = update.time_s
            self.takes_over = True
            self._choose()
            self._criterion_met("start", update)
            self._record(update)
        if update.stopped and log.stop_s is None:
            log.stop_s = update.time_s
            self._criterion_met("stop", update)
        self._session.parts.call("on_update", update, seconds)

    def _say_fall(self, update: "ModelUpdate", before: "ModelUpdate | None") -> None:
        """Report why the expected share is lower than before, on the same surface."""
        same = before is not None and before.surface == update.surface
        self.fell = update.progress.why_less_than(before.progress) if before and same else ""
        if self.fell:
            self._event(f"the expected share has fallen: {self.fell}")

    def _criterion_met(self, which: str, update: "ModelUpdate") -> None:
        details = {"distance": update.distance, **update.progress.as_dict()}
        self._event(f"{which} criterion met at {update.time_s:.1f} s", **details)
        self._tell_of_skin(update.model)

    def _tell_of_skin(self, model: "TextureModel | None") -> None:
        """Report and record how much of a model's power the actuator plays, if that is known."""
        found = None if self._vibration is None else self._vibration.response()
        if found is None or model is None:
            return
        from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse, skin_sentence

        response = ActuatorResponse(*found(FREQUENCIES_HZ))
        share = self.played_share = response.played_of(model)
        sentence = skin_sentence(share, response.low_hz)
        self._event(sentence, actuator_plays=round(share, 4))
        self._session.journal.record({"event": "actuator response", **response.as_dict()})

    def _follow_surface(self, update: "ModelUpdate", since_s: float, *, usable: bool) -> None:
        """Change to the model of another surface, if the tool has moved onto one."""
        from mmt.leader.surface_log import SurfaceLog

        log = self._log
        surfaces = log.surfaces = log.surfaces or SurfaceLog(since_s)
        for sentence, details in surfaces.record(update):
            self._event(sentence, **details)
        for left in update.left:
            self._record(replace(left, time_s=since_s + left.time_s))
        if not update.changes:
            return
        entry, now_s = surfaces.entry, update.time_s
        log.start_s = None if entry.start_s == now_s else entry.start_s
        log.stop_s = None if entry.stop_s == now_s else entry.stop_s
        self.takes_over = usable
        self._choose()

    def _render(self, model: "TextureModel", surface: int | None) -> None:
        """Render from a model; fade it in if its surface is another one than before."""
        synthesizing, vibration = self._synthesizing, self._vibration
        if synthesizing is None:
            return
        heard = vibration is not None and vibration.switch.mode in ("synthesized", "fading")
        if synthesizing.crossfade is not None and heard and surface != self._rendered:
            synthesizing.crossfade.cross_to(model)
        else:
            synthesizing.synthesizer.model = model
        self._rendered = surface

    async def use_shared(self, model: "TextureModel", surface: int | None) -> None:
        """Render a model that another leader shares; fade it in if its surface is another one."""
        from mmt.leader.output.synthesis import at_session_rate

        rate_hz = self._session.acceleration_rate_hz
        model, remark = await asyncio.to_thread(at_session_rate, model, rate_hz)
        if remark and remark != self._reported_rate:
            self._event(remark)
        self._reported_rate = remark
        self._render(model, surface)
        self.takes_over = True
        self._choose()

    def withhold_model(self) -> None:
        """Render no model until there is one that is ready."""
        self.takes_over = False
        self._choose()

    def reset(self) -> None:
        """Forget the model, and return to streamed vibration."""
        if self._modelling is None:
            self._session.journal.say("no model is reset: this scene has no [texture]")
            return
        self.record_last()
        self._modelling.reset()
        if self._generating is not None:
            self._generating.reset()
        self._log.surfaces = None
        self._recorded.clear()
        self._said, self._new_faults = SignalFaults(), SignalFaults()
        self._log.update = self._log.start_s = self._log.stop_s = None
        self.takes_over = False
        self.forced, self.fell, self.played_share = None, "", None
        self._choose()
        self._event("model reset", frozen=False)

    def force(self, mode: Literal["streamed", "synthesized"] | None) -> None:
        """Fix one vibration, or let the start criterion decide (None).

        Raises
        ------
        InputError
            The scene does not play or stream vibration, or there is no model to render from.
        """
        update, synthesizing = self._log.update, self._synthesizing
        if self._vibration is None:
            raise InputError("this scene plays no vibration: it has no [actuator]")
        if mode == "streamed" and not self._vibration.switch.streams:
            raise InputError("this scene streams no vibration: it has no [playout]")
        if mode == "synthesized":
            if synthesizing is None:
                raise InputError("this scene renders from no model: it has no [rendering]")
            if update is not None and update.model is not None:
                self._render(update.model, update.surface)
            elif not self.takes_over:  # a model that is rendered may be of before a reset
                raise InputError("there is no model yet: stroke the surface first")
        self.forced = mode
        self._choose()

    def _choose(self) -> None:
        """Make the switch play the forced vibration, or else that of the criterion."""
        if self._vibration is not None:
            model = self.takes_over if self.forced is None else self.forced == "synthesized"
            self._vibration.switch.use_model(model)

    def record_last(self) -> None:
        """Attach the newest model to the recording, and other surfaces' models that it lacks."""
        update, modelling = self._log.update, self._modelling
        if update is None:
            return
        for number, model in (modelling.models() if modelling is not None else {}).items():
            if number != update.surface:
                from mmt.texture.online.updates import ReadyModel

                self._record(replace(update, surface=number, source=ReadyModel(model)))
        self._record(update)

    def save_surfaces(self) -> list[str]:
        """Write each surface's model beside the recording; return a sentence for each failure."""
        modelling, recorder = self._modelling, self._running_recorder
        if self._log.surfaces is None or modelling is None or recorder is None:
            return []
        from mmt.leader.surface_log import write_surface_models

        return write_surface_models(recorder.path, modelling.models())

    @property
    def _running_recorder(self) -> "McapRecorder | None":
        return None if self._recording is None else self._recording.recorder

    def _record(self, update: "ModelUpdate") -> None:
        recorder, model, surface = self._running_recorder, update.model, update.surface
        if recorder is None or model is None:
            return
        if surface is not None:
            if recorder is not self._recorder:
                self._recorder = recorder
                self._recorded.clear()
            if self._recorded.get(surface) is model:
                return
            self._recorded[surface] = model
            samples = len(model.samples)
            recorder.record_event(
                {"kind": "model", "surface": surface, "samples": samples, "time_s": update.time_s}
            )
        recorder.attach_model(model.to_bytes, update.time_s)
