"""Error of the level at the skin, of the model and the session's actuator together."""

import numpy as np

from mmt.core.errors import InputError
from mmt.evaluation.grid_errors import Strokes
from mmt.evaluation.results import AtSkin
from mmt.evaluation.truth import KnownTexture
from mmt.session.stream import Recording
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse

_EVENT = "actuator response"
_LEAST = 1e-12


def at_skin(
    session: Recording,
    model: TextureModel | None,
    truth: KnownTexture | None,
    strokes: Strokes,
) -> AtSkin | None:
    """Return what reaches the skin, or None without a recorded response, a model or strokes.

    Parameters
    ----------
    session
        The recording; the last actuator response among its events is used.
    model
        The model that was rendered.
    truth
        The known texture; None to compare with the model itself.
    strokes
        The strokes made.

    Raises
    ------
    InputError
        The recorded response is not valid.
    """
    told = [event for event in session.events if event.get("event") == _EVENT]
    if not told or model is None or not len(strokes.force_n):
        return None
    try:
        response = ActuatorResponse.from_dict(told[-1])
    except InputError as error:
        raise InputError(f"session {session.path}: in its event {_EVENT!r} {error}") from error
    density = model.spectrum(*strokes.inputs(model.space).T, frequencies_hz=FREQUENCIES_HZ)
    wanted = density if truth is None else truth.spectrum(strokes, FREQUENCIES_HZ)
    played = (density * response.gain**2).sum(axis=1) + _LEAST
    error_db = 10.0 * np.log10(played / (wanted.sum(axis=1) + _LEAST))
    return AtSkin(
        played_share=float(np.mean(response.played_share(wanted))),
        low_hz=response.low_hz,
        power_error_db=float(np.sqrt(np.mean(np.square(error_db)))),
    )
