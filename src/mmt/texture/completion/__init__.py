"""When a model is good enough to render from, and when modelling ends."""

from mmt.texture.completion.criterion import Criterion
from mmt.texture.settings import ModellingSettings


def make_criterion(settings: ModellingSettings) -> Criterion:
    """Return the criterion that the settings name; the other one's module is not imported."""
    if settings.criterion == "uncertainty":
        from mmt.texture.completion.uncertainty import UncertaintyCriterion

        return UncertaintyCriterion(settings)
    from mmt.texture.completion.distance import CompletionMonitor

    dimensions = 3 if settings.inputs == "anisotropic" else 2
    return CompletionMonitor(*settings.distances, dimensions)
