"""What becomes of each new model: it is rendered, recorded and announced."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from mmt.errors import InputError
from mmt.leader.parts import LeaderParts
from mmt.leader.summary import RunLog

if TYPE_CHECKING:
    from mmt.texture.library_choice import Choice
    from mmt.texture.model import TextureModel
    from mmt.texture.modelling import ModelUpdate


class ModelUse:
    """Put the models of a session to use.

    Parameters
    ----------
    parts
        The leader's parts.
    log
        Where the updates are noted.
    event
        Called with a sentence and details for what a person wants to know.
    """

    def __init__(self, parts: LeaderParts, log: RunLog, event: Callable[..., None]) -> None:
        self._parts = parts
        self._log = log
        self._event = event
        self._since_s = 0.0
        synthesizer = parts.synthesizer
        self._takes_over = synthesizer is not None and synthesizer.model is not None
        self.forced: Literal["streamed", "synthesized"] | None = None
        """Which vibration a person holds on to, None where the criterion decides."""
        if parts.warming is not None:
            parts.warming.on_model = self.take_warm

    def take(self, update: "ModelUpdate", seconds: float) -> None:
        """Take an update of the model, which took so many seconds.

        Vibration is rendered from it as soon as the start criterion is met; until then from
        the saved model that the scene names or a known texture, if it has them.
        """
        log, parts = self._log, self._parts
        update = replace(update, time_s=self._since_s + update.time_s)
        log.update = update
        log.update_seconds.append(seconds)
        usable = update.started and update.model is not None
        forced = self.forced == "synthesized" and log.warm is None
        wanted = usable or (forced and update.model is not None)
        if wanted and parts.synthesizer is not None:
            parts.synthesizer.model = update.model
        if parts.warming is not None and not parts.warming.finished:
            if usable:
                parts.warming.finish()
            elif update.model is not None:
                parts.warming.learn(update.model.samples)
        if usable and log.start_s is None:
            log.start_s = update.time_s
            self._event(f"start criterion met at {update.time_s:.1f} s", distance=update.distance)
            self._record(update)
            self._takes_over = True
            self._choose()
        if update.stopped:
            log.stop_s = update.time_s
            self._event(f"stop criterion met at {update.time_s:.1f} s", distance=update.distance)

    def take_warm(self, model: "TextureModel", choice: "Choice") -> None:
        """Render from a known texture, blended with what is known of the one at hand."""
        log = self._log
        if log.start_s is not None or self._parts.synthesizer is None:
            return
        self._parts.synthesizer.model = model
        before = log.warm.name if log.warm is not None else None
        log.warm = choice
        self._takes_over = True
        self._choose()
        if choice.name != before:
            self._event(f"nearest known texture: {choice.describe()}", **choice.as_dict())

    def reset(self, time_s: float) -> None:
        """Forget the model at a session time, and return to streamed vibration."""
        if self._parts.modelling is None:
            return
        self.record_last()
        self._parts.modelling.reset()
        if self._parts.warming is not None:
            self._parts.warming.reset()
        self._log.warm = None
        self._since_s = time_s
        self._log.update = self._log.start_s = self._log.stop_s = None
        self._takes_over = False
        self.forced = None
        self._choose()
        self._event("model reset")

    def force(self, mode: Literal["streamed", "synthesized"] | None) -> None:
        """Hold on to one vibration, or let the start criterion decide (None).

        Raises
        ------
        InputError
            The scene streams none, or there is no model to render from.
        """
        parts, update = self._parts, self._log.update
        if parts.switch is None:
            raise InputError("this scene plays no vibration: it has no [actuator]")
        if mode == "streamed" and parts.playout is None:
            raise InputError("this scene streams no vibration: it has no [playout]")
        if mode == "synthesized":
            if parts.synthesizer is None:
                raise InputError("this scene renders from no model: it has no [rendering]")
            warm = self._log.warm is not None and self._log.start_s is None
            if update is not None and update.model is not None and not warm:
                parts.synthesizer.model = update.model
            if parts.synthesizer.model is None:
                raise InputError("there is no model yet: stroke the surface first")
        self.forced = mode
        self._choose()

    def _choose(self) -> None:
        """Let the switch play what is forced, or else what the criterion says."""
        if self._parts.switch is not None:
            model = self._takes_over if self.forced is None else self.forced == "synthesized"
            self._parts.switch.use_model(model)

    def record_last(self) -> None:
        """Attach the newest model to the recording."""
        if self._log.update is not None:
            self._record(self._log.update)

    def _record(self, update: "ModelUpdate") -> None:
        if self._parts.recorder is not None and update.model is not None:
            self._parts.recorder.attach_model(update.model.to_bytes(), update.time_s)
