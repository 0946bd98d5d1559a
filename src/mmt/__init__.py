"""Model-mediated teleoperation of haptic texture.

The names below are the public API: sessions, texture models, rendering, evaluation, simulation
and the two services. Each is imported on first use, so that ``import mmt`` is quick and a program
loads only what it needs. Other modules can be imported too, but their names may change.

Examples
--------
>>> import mmt
>>> import numpy as np
>>> frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=6.0)
>>> history = mmt.build_model(frames, mmt.ModellingSettings(), update_s=1.0)
>>> history.start_s is not None
True
>>> model = history.model_at(6.0)
>>> vibration_m_s2 = mmt.Synthesizer(model, seed=1).render(np.full(500, 100.0), np.ones(500))
>>> vibration_m_s2.shape
(500,)
"""

import importlib
from typing import TYPE_CHECKING, Any

from mmt.core.extras import __version__, optional_import

if TYPE_CHECKING:
    from mmt.core.errors import InputError, MmtError
    from mmt.evaluation.evaluate import evaluate_session, evaluate_surfaces
    from mmt.evaluation.results import Evaluation
    from mmt.follower.service import Follower
    from mmt.leader.service import Leader
    from mmt.scene import Scene
    from mmt.scene.files import load_scene
    from mmt.session.data import RecordedSession
    from mmt.session.files import export_session, import_session, read_session, write_session
    from mmt.testing.simulation.offline import simulate_session
    from mmt.texture.model.texture_model import TextureModel, load_model
    from mmt.texture.online.history import ModelHistory, build_model
    from mmt.texture.settings import ModellingSettings, SurfaceSettings
    from mmt.texture.space import TextureSamples
    from mmt.texture.surfaces.tracking import follow_surfaces
    from mmt.texture.synthesis.synthesizer import Synthesizer

__all__ = [
    "Evaluation", "Follower", "InputError", "Leader", "MmtError", "ModelHistory",
    "ModellingSettings", "RecordedSession", "Scene", "SurfaceSettings", "Synthesizer",
    "TextureModel", "TextureSamples", "__version__", "build_model", "evaluate_session",
    "evaluate_surfaces", "export_session", "follow_surfaces", "import_session", "load_model",
    "load_scene", "read_session", "simulate_session", "write_session",
]  # fmt: skip

_HOMES = {
    "Evaluation": "mmt.evaluation.results",
    "Follower": "mmt.follower.service",
    "InputError": "mmt.core.errors",
    "Leader": "mmt.leader.service",
    "MmtError": "mmt.core.errors",
    "ModelHistory": "mmt.texture.online.history",
    "ModellingSettings": "mmt.texture.settings",
    "RecordedSession": "mmt.session.data",
    "Scene": "mmt.scene",
    "SurfaceSettings": "mmt.texture.settings",
    "Synthesizer": "mmt.texture.synthesis.synthesizer",
    "TextureModel": "mmt.texture.model.texture_model",
    "TextureSamples": "mmt.texture.space",
    "build_model": "mmt.texture.online.history",
    "evaluate_session": "mmt.evaluation.evaluate",
    "evaluate_surfaces": "mmt.evaluation.evaluate",
    "export_session": "mmt.session.files",
    "follow_surfaces": "mmt.texture.surfaces.tracking",
    "import_session": "mmt.session.files",
    "load_model": "mmt.texture.model.texture_model",
    "load_scene": "mmt.scene.files",
    "read_session": "mmt.session.files",
    "simulate_session": "mmt.testing.simulation.offline",
    "write_session": "mmt.session.files",
}
"""Module that defines each name."""


if not TYPE_CHECKING:  # type checkers would take any name for an attribute of the module

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        with optional_import():
            value = getattr(importlib.import_module(_HOMES[name]), name)
        globals()[name] = value  # the next access does not call this function
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
