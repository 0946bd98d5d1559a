"""The part that holds the synthesizer, and the speed of the touch-downs that it renders."""

from collections import deque
from typing import TYPE_CHECKING, Final

from mmt.devices.leader_reports import InterfaceState
from mmt.leader.part import Part, Session

if TYPE_CHECKING:
    from mmt.leader.output.model_crossfade import ModelCrossfade
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.synthesis.synthesizer import Synthesizer

APPROACH_S: Final = 0.02
"""Time before the contact over which the approach speed is averaged."""


def at_session_rate(model: "TextureModel", rate_hz: float) -> "tuple[TextureModel, str]":
    """Return a model at the rate of a session's vibration, and a sentence if its own rate differs.

    Slow for a large model: not for the event loop.
    """
    if model.rate_hz == rate_hz:
        return model, ""
    above = f"above {min(model.rate_hz, rate_hz) / 2.0:g} Hz"
    what = (
        f"nothing {above} is in it" if model.rate_hz < rate_hz else f"what is {above} is left out"
    )
    rate_remark = f"the model is of {model.rate_hz:g} Hz and is played at {rate_hz:g} Hz: {what}"
    return model.at_rate(rate_hz), rate_remark


class SynthesizingPart(Part):
    """Holds the synthesizer from which the tick renders; the newest model is assigned to it.

    Parameters
    ----------
    synthesizer
        Renders from one model.
    crossfade
        The same synthesizer, if it crossfades from one surface's model to another's.
    rate_remark
        Sentence for the user about the saved model, "" for none.
    """

    def __init__(
        self,
        synthesizer: "Synthesizer | ModelCrossfade",
        crossfade: "ModelCrossfade | None" = None,
        rate_remark: str = "",
    ) -> None:
        self.synthesizer = synthesizer
        self.crossfade = crossfade
        self.rate_remark = rate_remark

    @classmethod
    def build(cls, session: Session) -> "SynthesizingPart | None":
        """Return the part with the scene's saved model, or None without rendering or actuator.

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

        first, rate_remark = made(scene.session.seed), ""
        if table.model is not None:
            from mmt.models import find_model
            from mmt.texture.model.texture_model import TextureModel

            saved = TextureModel.load(find_model(table.model))
            first.model, rate_remark = at_session_rate(saved, session.acceleration_rate_hz)
        several = scene.texture is not None and scene.texture.surfaces is not None
        if not several and not scene.is_given("model"):
            return cls(first, rate_remark=rate_remark)
        from mmt.leader.output.model_crossfade import ModelCrossfade

        samples = round(table.crossfade_ms * session.acceleration_rate_hz / 1000)
        crossfade = ModelCrossfade(first, made(scene.session.seed + 1), crossfade_samples=samples)
        return cls(crossfade, crossfade, rate_remark)


class Landing:
    """Measure the approach speed when a hand's contact begins.

    Parameters
    ----------
    normal
        Number of the surface's normal axis.
    rate_hz
        Rate of the ticks.
    """

    def __init__(self, normal: int, rate_hz: float) -> None:
        self._normal = normal
        self._count = round(APPROACH_S * rate_hz)
        self._speeds: deque[float] = deque(maxlen=self._count)

    def step(self, state: InterfaceState | None, elapsed: int) -> float:
        """Return the approach speed (mm/s) at the first tick of a contact, else 0.

        Return 0 too if the hand was not in the air for `APPROACH_S`. ``elapsed`` is the number of
        ticks since the last call.
        """
        if state is not None and not state.contact:
            ticks = min(elapsed, self._count)
            self._speeds.extend([-state.velocity_mm_s[self._normal]] * ticks)
            return 0.0
        if not self._speeds:
            return 0.0
        mean, whole = sum(self._speeds) / len(self._speeds), len(self._speeds) == self._count
        self._speeds.clear()
        return max(0.0, mean) if whole and state is not None else 0.0
