"""A model for each surface: the online update of several texture models from one stream.

The stream is checked several times between two updates of a model, so that changes are detected
early. Detection is a few blocks late: segments from the change-point on are removed from the former
surface's model again, and their frames go to the model of the new one. Each model meets its
criteria by itself; one that is complete stays as it is.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.modeller import OnlineModeller, run_stages
from mmt.texture.online.updates import ModelUpdate, SurfaceChange, SurfaceStatement, UpdateWork
from mmt.texture.settings import ModellingSettings, SurfaceSettings, surface_check_frames
from mmt.texture.surfaces.tracking import NAMED_S, SurfaceTracker

REMEMBERED_S: Final = NAMED_S + 26.0
"""Seconds of frames kept, in case a person names a new surface as a known one: its detection may
have taken some seconds of stroking."""


class SurfaceModeller:
    """Track the surfaces, and build a texture model of each.

    Cost: that of `SurfaceTracker` and, once a period, of one `OnlineModeller`. Memory: the models,
    and the frames of `REMEMBERED_S`. The number of frames at a time does not change the surfaces.

    Parameters
    ----------
    settings
        Settings of the modelling; ``surfaces`` sets how surfaces are told apart, None takes
        the defaults.
    period_frames
        Frames between two updates of a model.
    """

    def __init__(self, settings: ModellingSettings, period_frames: int) -> None:
        self._settings = settings
        self._period_frames = period_frames
        self._look_frames = surface_check_frames(settings.rate_hz)
        self._tracker = SurfaceTracker(settings, settings.surfaces or SurfaceSettings())
        self._modellers = {self._tracker.surface: OnlineModeller(settings)}
        self._recent: list[RecordArray] = []
        self._given = -1  # newest frame that the current surface's model has
        self._first_sequence: int | None = None

    @property
    def surface(self) -> int:
        """The number of the surface that the tool is taken to be on."""
        return self._tracker.surface

    def state_surface(self, statement: SurfaceStatement) -> None:
        """Record a person's statement on the surface. See `SurfaceTracker`."""
        self._tracker.state_surface(statement)

    @property
    def kept(self) -> tuple[int, ...]:
        """Numbers of the surfaces whose models are kept."""
        return tuple(self._modellers)

    def models(self) -> dict[int, TextureModel]:
        """Return the model of each surface that has one, by number."""
        found = {number: modeller.model for number, modeller in self._modellers.items()}
        return {number: model for number, model in found.items() if model is not None}

    def update(self, frames: RecordArray) -> ModelUpdate | None:
        """Add the newest frames (n,); return an update if one is due."""
        return run_stages(self.segment(frames))

    def segment(self, frames: RecordArray) -> Iterator[UpdateWork]:
        """Track the surface over the newest frames (n,), and yield the work of updating models.

        An update is due once a period, and at every change.
        Each yielded work must be carried out before the next is asked for: the frames that a model
        is given depend on whether the model is complete.
        """
        if not len(frames):
            return
        if self._first_sequence is None:
            self._first_sequence = int(frames["sequence"][0])
            self._given = self._first_sequence - 1
        changes: list[SurfaceChange] = []
        left: list[ModelUpdate] = []
        for start in range(0, len(frames), self._look_frames):
            look = frames[start : start + self._look_frames]
            self._remember(look)
            found = self._tracker.update(look)
            for change in found:
                yield from self._leave(change, left)
            changes += found
        newest = int(frames["sequence"][-1])
        if not changes and newest - self._given < self._period_frames:
            return
        time_s = self._time_s(newest + 1)
        for work in self._give(newest + 1):
            work.announced = True
            work.surface, work.session_time_s = self.surface, time_s
            work.changes, work.left = tuple(changes), tuple(left)
            work.faults = self._tracker.faults  # a model has the frames of its stays alone
            yield work

    def _time_s(self, sample: int) -> float:
        return (sample - (self._first_sequence or 0)) / self._settings.rate_hz

    def _remember(self, frames: RecordArray) -> None:
        self._recent.append(frames)
        oldest = int(frames["sequence"][-1]) - REMEMBERED_S * self._settings.rate_hz
        while int(self._recent[0]["sequence"][-1]) < oldest:
            del self._recent[0]

    def _give(self, until: int, surface: int | None = None) -> Iterator[UpdateWork]:
        """Give a surface's model (by default the current one) its frames up to a sample."""
        modeller = self._modellers[surface or self.surface]
        waiting = [
            part
            for block in self._recent
            if int(block["sequence"][-1]) > self._given
            and len(part := block[(block["sequence"] > self._given) & (block["sequence"] < until)])
        ]
        self._given = max(self._given, until - 1)
        complete = modeller.completion.stopped or not waiting
        frames = self._recent[-1][:0] if complete else np.concatenate(waiting)
        for work in modeller.segment(frames):
            work.announced = False
            yield work

    def _leave(self, change: SurfaceChange, left: list[ModelUpdate]) -> Iterator[UpdateWork]:
        """Divide the frames between the models of two surfaces at the change-point."""
        if change.kind != "identified":  # else they were the same all along
            yield from self._give(change.from_sample, change.before)
            work = self._modellers[change.before].remove_after(change.from_sample)
            work.announced, work.surface = False, change.before
            work.session_time_s = self._time_s(change.from_sample)
            yield work
            if work.update is not None:
                left.append(work.update)
        kept = {*self._tracker.surfaces, change.surface}
        self._modellers = {n: m for n, m in self._modellers.items() if n in kept}
        self._modellers.setdefault(change.surface, OnlineModeller(self._settings))
        self._given = change.from_sample - 1
