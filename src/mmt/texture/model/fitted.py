"""What a texture model has found in its samples and keeps, so that it can be built again as it is.

Fitting the exponents anew costs little, choosing the networks' settings most of what building
them takes; and a model that has grown may have been told its own at fewer samples than it has.
"""

from dataclasses import dataclass

from mmt.core.arrays import FloatArray
from mmt.texture.field.trend import Trend
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings


@dataclass(frozen=True)
class Fitted:
    """Of one model.

    Attributes
    ----------
    trend
        The power law over which its level is interpolated, `NO_TREND` for an isotropic one.
    networks
        Settings of the networks of level and filters; empty with another interpolator.
    level
        Logarithms of the hyperparameters of `mmt.texture.field.level_process.LevelProcess`; None
        where the level is interpolated.
    """

    trend: Trend
    networks: tuple[RadialBasisSettings, ...]
    level: FloatArray | None = None
