"""The models of several surfaces as files beside the recording of their session."""

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel


def model_file(recording: Path, surface: int) -> Path:
    """Return where the model of a surface is kept: ``session-surface-2.npz``."""
    return recording.with_name(f"{recording.stem}-surface-{surface}.npz")


def write_surface_models(recording: Path, models: "Mapping[int, TextureModel]") -> list[str]:
    """Write a model file for each surface; those of an earlier recording of that name go.

    Returns
    -------
    problems
        A sentence for each file that could not be written.
    """
    ours = re.compile(re.escape(recording.stem) + r"-surface-[0-9]+\.npz")
    with suppress(OSError):
        for old in recording.parent.iterdir():
            if ours.fullmatch(old.name):
                old.unlink()
    problems = []
    for number, model in models.items():
        path = model_file(recording, number)
        try:
            model.save(path)
        except OSError as error:
            problems.append(f"the model of surface {number}, {path}: {error.strerror or error}")
    return problems
