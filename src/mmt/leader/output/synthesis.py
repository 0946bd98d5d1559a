"""The part that holds what the tick renders from."""

from typing import TYPE_CHECKING

from mmt.leader.output.model_crossfade import ModelCrossfade
from mmt.leader.part import Part, Session

if TYPE_CHECKING:
    from mmt.texture.synthesis.synthesizer import Synthesizer


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
            The scene names a model that cannot be read, or is of another rate.
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
            first.model.check_rate(session.rate_hz)
        several = scene.texture is not None and scene.texture.surfaces is not None
        if not several and not scene.is_given("model"):
            return cls(first)
        samples = round(table.crossfade_ms * session.rate_hz / 1000)
        crossfade = ModelCrossfade(first, made(scene.session.seed + 1), crossfade_samples=samples)
        return cls(crossfade, crossfade)
