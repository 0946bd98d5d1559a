"""All kinds of surfaces with an exactly known texture: their truth and their vibration."""

import json
from typing import TYPE_CHECKING, TypeAlias, Union

import numpy as np

from mmt.core.errors import InputError
from mmt.testing.simulation.surfaces.surface import (
    ALTERED_VERSION,
    COURSE_VERSION,
    GRAINED_VERSION,
    MODEL_VERSION,
    VERSION,
    Surface,
    surface_from_parameters,
)
from mmt.testing.simulation.surfaces.vibration import SurfaceVibration, VibrationSource

if TYPE_CHECKING:
    from mmt.testing.simulation.surfaces.altered_surface import AlteredSurface
    from mmt.testing.simulation.surfaces.model_surface import ModelSurface

KnownSurface: TypeAlias = Union[Surface, "AlteredSurface", "ModelSurface"]
"""A texture of this project, altered or not, or that of a model; the rare ones are not imported."""


def surface_from_annotations(annotations: bytes) -> KnownSurface:
    """Rebuild the surface that a recording's annotations describe.

    Raises
    ------
    InputError
        The bytes hold no truth of a known version.
    """
    try:
        truth = json.loads(annotations)
        version, name, parameters = truth["version"], str(truth["surface"]), truth["parameters"]
        if version == COURSE_VERSION:
            raise InputError("the session goes over several surfaces: mmt lab surfaces")
        if version == MODEL_VERSION:
            from mmt.testing.simulation.surfaces.model_surface import from_parameters

            return from_parameters(name, parameters)
        if version == ALTERED_VERSION:
            from mmt.testing.simulation.surfaces.altered_surface import (
                AlteredSurface,
                from_altered_parameters,
            )

            base = surface_from_annotations(json.dumps(parameters["base"]).encode())
            if isinstance(base, AlteredSurface):
                raise InputError("annotations hold an altered surface of an altered one")
            return from_altered_parameters(name, base, parameters)
        if version in {VERSION, GRAINED_VERSION}:
            return surface_from_parameters(name, parameters)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"annotations hold no simulated truth: {error!r}") from error
    raise InputError(
        f"annotations: version {version} of the simulated truth is not known, this program reads "
        f"{VERSION}, {GRAINED_VERSION}, {MODEL_VERSION} and {ALTERED_VERSION}"
    )


def vibration_of(surface: KnownSurface, generator: np.random.Generator) -> VibrationSource:
    """Return the generator of a surface's vibration."""
    if isinstance(surface, Surface):
        return SurfaceVibration(surface, generator)
    from mmt.testing.simulation.surfaces.altered_surface import AlteredSurface, AlteredVibration

    if isinstance(surface, AlteredSurface):
        source, chance = generator.spawn(2)
        return AlteredVibration(surface, vibration_of(surface.base, source), chance)
    from mmt.testing.simulation.surfaces.model_surface import ModelVibration

    return ModelVibration(surface, generator)
