"""What becomes of each new model: it is rendered, recorded and announced."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from mmt.leader.parts import LeaderParts
from mmt.leader.summary import RunLog

if TYPE_CHECKING:
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

    def take(self, update: "ModelUpdate", seconds: float) -> None:
        """Take an update of the model, which took so many seconds.

        Vibration is rendered from it as soon as the start criterion is met; until then from
        the saved model that the scene names, if it does.
        """
        log, parts = self._log, self._parts
        update = replace(update, time_s=self._since_s + update.time_s)
        log.update = update
        log.update_seconds.append(seconds)
        usable = update.started and update.model is not None
        if usable and parts.synthesizer is not None:
            parts.synthesizer.model = update.model
        if usable and log.start_s is None:
            log.start_s = update.time_s
            self._event(f"start criterion met at {update.time_s:.1f} s", distance=update.distance)
            self._record(update)
            if parts.switch is not None:
                parts.switch.use_model(True)
        if update.stopped:
            log.stop_s = update.time_s
            self._event(f"stop criterion met at {update.time_s:.1f} s", distance=update.distance)

    def reset(self, time_s: float) -> None:
        """Forget the model at a session time, and return to streamed vibration."""
        if self._parts.modelling is None:
            return
        self.record_last()
        self._parts.modelling.reset()
        self._since_s = time_s
        self._log.update = self._log.start_s = self._log.stop_s = None
        if self._parts.switch is not None:
            self._parts.switch.use_model(False)
        self._event("model reset")

    def record_last(self) -> None:
        """Attach the newest model to the recording."""
        if self._log.update is not None:
            self._record(self._log.update)

    def _record(self, update: "ModelUpdate") -> None:
        if self._parts.recorder is not None and update.model is not None:
            self._parts.recorder.attach_model(update.model.to_bytes(), update.time_s)
