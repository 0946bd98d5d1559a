"""The shipped texture models: how each is built, and how far it is from the truth."""

from collections.abc import Sequence
from typing import Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.evaluation.model_errors import SectorErrors, overall
from mmt.evaluation.truth import KnownTexture
from mmt.scene import Hand, Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online import history
from mmt.texture.settings import Inputs, ModellingSettings

TRIALS: Final = 6
DURATION_S: Final = 20.0
FIRST_SEED: Final = 1

ORDERS: Final = {
    "ridged-plastic": 11,
    "brushed-plastic": 4,
    "knurled-plastic": 11,
    "felt": 4,
    "canvas": 10,
    "corduroy": 11,
    "oak": 5,
    "pine": 6,
    "sawn-wood": 10,
}
"""Order of the filters of each."""


def trials_of(surface: Surface) -> list[RecordArray]:
    """Simulate the trials from which the model of a surface is built.

    The hand covers all headings; the robot and its noisy sensors are the default ones.
    """
    scene = Scene(hand=Hand(headings="all"))
    return [
        simulate_session(scene, surface, DURATION_S, FIRST_SEED + trial)[0]
        for trial in range(TRIALS)
    ]


def settings_of(surface: Surface) -> ModellingSettings:
    """Return the settings by which a surface is modelled; heading counts if not isotropic."""
    inputs: Inputs = "isotropic" if surface.isotropic else "anisotropic"
    return ModellingSettings(inputs=inputs, order=ORDERS[surface.name])


def build(sessions: Sequence[RecordArray], settings: ModellingSettings) -> TextureModel:
    """Build the model of a surface from trials on it, as it is shipped.

    The level is that of the samples: with so many samples, the blocks would add little information
    but double the size of the file.
    """
    model = history.build(history.trials(sessions), settings).updates[-1].model
    if model is None:
        raise InputError(f"no steady stroke in {len(sessions)} trials: nothing can be modelled")
    return TextureModel(model.samples, method=settings.method, rate_hz=settings.rate_hz)


def measure(name: str, model: TextureModel) -> SectorErrors:
    """Return a model's errors against its texture, over all strokes of the plane."""
    return overall(KnownTexture(get_surface(name)).plane.errors(model))
