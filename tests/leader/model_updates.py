"""Updates of a model as the modelling makes them."""

from mmt.texture.completion.distance import CompletionMonitor
from mmt.texture.online.updates import ModelUpdate, ReadyModel
from mmt.texture.settings import ModellingSettings


def made_update(time_s, model=None, **changes):
    """Return an update that has met no criterion, with this model if there is one."""
    values = {
        "samples": 9 if model else 0, "added": 0, "removed": 0, "distance": 5.0, "order": 10,
        "progress": CompletionMonitor(ModellingSettings(method="published")).progress,
        "started": False, "stopped": False, "source": ReadyModel(model), "durations_s": {},
    }  # fmt: skip
    return ModelUpdate(time_s=time_s, **values | changes)
