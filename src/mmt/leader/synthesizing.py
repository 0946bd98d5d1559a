"""The task that synthesizes: fits in, an immutable model out, from which the tick renders.

The task chooses the fits that the model is made of and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

import math
from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.leader.part import Part, Session
from mmt.leader.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.work import Work
    from mmt.texture.synthesis.synthesizer import Synthesizer


def _choose(work: "Work") -> None:
    work.modeller.choose(work)


def _build(work: "Work") -> None:
    work.modeller.build(work)


class SynthesizingTask(StageTask):
    """Build the model of one update after the other; parameters as of `StageTask`."""

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_choose, _build), worker, queue, activity, deliver)


class SynthesizingPart(Part):
    """Holds what the tick renders from; the newest model is assigned to it.

    Parameters
    ----------
    synthesizer
        Renders from one model.
    crossfade
        The same, where it goes from one surface's model to another's.
    """

    def __init__(
        self, synthesizer: "Synthesizer | ModelCrossfade", crossfade: "ModelCrossfade | None" = None
    ) -> None:
        self.synthesizer = synthesizer
        self.crossfade = crossfade

    @classmethod
    def build(cls, session: Session) -> "SynthesizingPart | None":
        """Return the synthesizer with the scene's saved model, None without an actuator.

        Raises
        ------
        InputError
            The scene names a model that cannot be read.
        """
        scene, table = session.scene, session.scene.rendering
        if table is None or scene.actuator is None:
            return None
        from mmt.texture.synthesis.synthesizer import Synthesizer

        def made(seed: int, limit_m_s2: float = scene.actuator.limit_m_s2) -> Synthesizer:
            return Synthesizer(
                seed=seed, renewal_samples=table.renewal_samples, limit_m_s2=limit_m_s2
            )

        first = made(scene.session.seed)
        if table.model is not None:
            from mmt.models import find_model
            from mmt.texture.model.texture_model import TextureModel

            first.model = TextureModel.load(find_model(table.model))
        several = scene.texture is not None and scene.texture.surfaces is not None
        if not several and scene.listening is None:
            return cls(first)
        samples = round(table.crossfade_ms * session.rate_hz / 1000)
        crossfade = ModelCrossfade(first, made(scene.session.seed + 1), crossfade_samples=samples)
        return cls(crossfade, crossfade)


class ModelCrossfade:
    """Two synthesizers used like one, with a crossfade from one surface's model to another's.

    The crossfade keeps the power of two uncorrelated signals (gains cosine and sine). A fade
    that has begun is completed; the next one follows it.

    Parameters
    ----------
    one, other
        With different seeds, so that their vibrations are uncorrelated.
    crossfade_samples
        Length of a fade; 0 switches at once.
    """

    def __init__(self, one: "Synthesizer", other: "Synthesizer", *, crossfade_samples: int) -> None:
        self._current, self._other = one, other
        self._length = crossfade_samples
        self._left = 0
        self._next: TextureModel | None = None

    @property
    def model(self) -> "TextureModel | None":
        """The model that is rendered, or will be; assigning another of its surface is no fade."""
        return self._current.model if self._next is None else self._next

    @model.setter
    def model(self, model: "TextureModel | None") -> None:
        if self._next is None:
            self._current.model = model
        else:
            self._next = model

    @property
    def directed(self) -> bool:
        """Whether the models are ones of velocity, not of speed."""
        return self._current.directed

    def cross_to(self, model: "TextureModel") -> None:
        """Fade to the model of another surface."""
        if self._left:
            self._next = model
            return
        self._current, self._other = self._other, self._current
        self._current.model = model
        self._current.reset()
        self._left = self._length

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples in m/s2; see `Synthesizer.render`."""
        now = self._current.render(*inputs)
        if not self._left:
            return now
        before = self._other.render(*inputs)
        passed = self._length - self._left + 1 + np.arange(len(now))
        angle = 0.5 * math.pi * np.minimum(passed / self._length, 1.0)
        self._left = max(0, self._left - len(now))
        if not self._left and self._next is not None:
            following, self._next = self._next, None
            self.cross_to(following)
        faded: FloatArray = np.cos(angle) * before + np.sin(angle) * now
        return faded
