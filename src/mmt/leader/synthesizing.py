"""The task that builds the interpolated model from new fits, and what the tick renders from.

The task chooses the fits that the model is made of and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.model_crossfade import ModelCrossfade
from mmt.leader.part import Part, Session
from mmt.leader.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work
    from mmt.texture.synthesis.synthesizer import Synthesizer


def _build(work: "Work") -> None:
    work.modeller.build(work)


class SynthesizingTask(StageTask):
    """Build the interpolated model from the fits of one update after the other.

    Parameters as of `StageTask`; the model is a snapshot that rendering gets once it is judged.
    """

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_build,), worker, queue, activity, deliver)


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
                seed=seed,
                renewal_samples=table.renewal_samples,
                limit_m_s2=limit_m_s2,
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
