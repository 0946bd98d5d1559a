"""Numerics of haptic texture: arrays in, arrays out.

The names below are loaded on first use, so that a program which needs none of them starts
without numba or scipy::

    from mmt.texture import TextureModel, Synthesizer
    model = TextureModel.load(Path("plastic.npz"))
    vibration_m_s2 = Synthesizer(model, seed=1).render(speed_mm_s, force_n)
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mmt.texture.autoregression.burg import burg_batch
    from mmt.texture.autoregression.forms import lsf_to_ar, reflection_to_lsf
    from mmt.texture.model.texture_model import TextureModel, TextureSamples
    from mmt.texture.online.modeller import OnlineModeller
    from mmt.texture.segmentation.segmenter import OnlineSegmenter, segment
    from mmt.texture.signals.filtering import StreamFilter
    from mmt.texture.synthesis.synthesizer import Synthesizer

_HOMES = {
    "OnlineModeller": "online.modeller",
    "OnlineSegmenter": "segmentation.segmenter",
    "StreamFilter": "signals.filtering",
    "Synthesizer": "synthesis.synthesizer",
    "TextureModel": "model.texture_model",
    "TextureSamples": "model.texture_model",
    "burg_batch": "autoregression.burg",
    "lsf_to_ar": "autoregression.forms",
    "reflection_to_lsf": "autoregression.forms",
    "segment": "segmentation.segmenter",
}

__all__ = [
    "OnlineModeller",
    "OnlineSegmenter",
    "StreamFilter",
    "Synthesizer",
    "TextureModel",
    "TextureSamples",
    "burg_batch",
    "lsf_to_ar",
    "reflection_to_lsf",
    "segment",
]


if not TYPE_CHECKING:  # as in `mmt`

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
