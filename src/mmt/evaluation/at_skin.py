"""The error at the skin: of the model and of what the session's actuator made of it."""

from collections.abc import Iterable

import numpy as np

from mmt.evaluation.grid_errors import Strokes
from mmt.evaluation.results import AtSkin
from mmt.evaluation.truth import KnownTexture
from mmt.session.data import JsonObject
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse

_LEAST = 1e-12


def at_skin(
    events: Iterable[JsonObject],
    model: TextureModel | None,
    truth: KnownTexture | None,
    strokes: Strokes,
) -> AtSkin | None:
    """Return what reaches the skin, None if the recording tells no response of an actuator.

    Parameters
    ----------
    events
        Those of the recording; the last response holds.
    model
        What was rendered.
    truth
        The known texture, None where there is none: the model then stands for it.
    strokes
        The strokes made.
    """
    told = [event for event in events if event.get("event") == "actuator response"]
    response = ActuatorResponse.from_dict(told[-1]) if told else None
    if response is None or model is None or not len(strokes.force_n):
        return None
    density = model.spectrum(*strokes.inputs(model.space).T, frequencies_hz=FREQUENCIES_HZ)
    wanted = density if truth is None else truth.spectrum(strokes, FREQUENCIES_HZ)
    played = (density * response.gain**2).sum(axis=1) + _LEAST
    error_db = 10.0 * np.log10(played / (wanted.sum(axis=1) + _LEAST))
    return AtSkin(
        played_share=float(np.mean(response.played_share(wanted))),
        low_hz=response.low_hz,
        power_error_db=float(np.sqrt(np.mean(np.square(error_db)))),
    )
