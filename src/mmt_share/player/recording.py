"""Record strokes on the page as sessions that the evaluation reads, one for each texture.

The page sends its motion; the vibration is rendered here from the model, with another excitation.
A session's time only counts while its texture is touched. At each new touch one frame number is
skipped, so that filters start anew there, as between trials. A frame has as many samples of
vibration as the fastest model has in 1 ms, ten at most.
"""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.existing import require_absent, write_error
from mmt.core.frames import CHANNELS, MOST_SAMPLES, empty_frames
from mmt.rendering import close, open_textures, render, touch
from mmt.session.data import FRAME_PERIOD_NS
from mmt.session.recorder import Existing, McapRecorder
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.messages import Step

_FRAME_S: Final = FRAME_PERIOD_NS / 1e9
_RETURN_S: Final = 1.0
"""Time constant with which the recorded path returns to the position of the hand; the path is the
integral of the rendered velocity."""
_ESTIMATE_HZ: Final = 200.0
_SILENCE: Final = 100
"""Frames that are rendered between two touches, so that the vibration of the first one fades."""


class TouchRecorder:
    """Write a session for each texture that is touched.

    Parameters
    ----------
    path
        The file; if there are several textures, each one's name is appended to the stem.
    names, models
        The textures.
    seed
        Seed of the excitation.
    replace
        Whether to replace files that exist.

    Raises
    ------
    InputError
        One of the files exists and is not to be replaced, or the folder may not be written to.
    """

    def __init__(
        self,
        path: str | Path,
        names: Sequence[str],
        models: Sequence[TextureModel],
        *,
        seed: int = 0,
        replace: bool = False,
    ) -> None:
        self._path = Path(path)
        self._names = tuple(names)
        self._models = tuple(models)
        self._files: dict[int, _TextureFile] = {}
        self._down: _TextureFile | None = None
        self._refusal: str | None = None
        fastest_hz = max(model.rate_hz for model in models)
        self._samples = min(math.ceil(fastest_hz * _FRAME_S), MOST_SAMPLES)
        self._textures = open_textures(
            models, output_hz=self._samples / _FRAME_S, estimate_hz=_ESTIMATE_HZ, seed=seed
        )
        self._existing: Existing = "replace" if replace else "refuse"
        for texture in range(len(names)):
            require_absent(self.path_of(texture), force=replace)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=self._path.parent).close()
        except OSError as error:  # files are opened at the first touch
            raise write_error(self._path, error) from error

    def path_of(self, texture: int) -> Path:
        """Return the file of a texture's session."""
        if len(self._names) == 1:
            return self._path
        return self._path.with_name(f"{self._path.stem}-{self._names[texture]}{self._path.suffix}")

    @property
    def seconds(self) -> float:
        """Total time of touch in s."""
        return sum(file.frames for file in self._files.values()) * _FRAME_S

    @property
    def problem(self) -> str | None:
        """Why a recording stopped, or None if none did."""
        if self._refusal is not None:
            return self._refusal
        for file in self._files.values():
            if file.recorder.error is not None:
                return f"recording {file.recorder.path}: {file.recorder.error}"
        return None

    def end_touch(self) -> None:
        """End the touch: the next one starts anew."""
        if self._down is not None:
            self._down = None
            touch(self._textures, None)
            render(self._textures, _SILENCE * self._samples)

    def record(self, texture: int, steps: Sequence[Step]) -> None:
        """Record a part of a stroke over a texture.

        If a file cannot be created, `problem` says so, and nothing more is recorded.
        """
        if self._refusal is not None or not steps:
            return
        file = self._files.get(texture)
        if file is None:
            try:
                file = self._files[texture] = self._open(texture)
            except InputError as error:
                self._refusal = str(error)
                return
        if file is not self._down:
            self.end_touch()
            self._down = file
            file.begin(steps[0])
        for step in steps:
            touch(self._textures, texture, step.x_mm_s, step.y_mm_s, step.force_n)
            file.write(step, render(self._textures, step.duration_ms * self._samples))

    def close(self) -> list[tuple[Path, float]]:
        """Close the files; return each with its duration in s."""
        close(self._textures)
        for file in self._files.values():
            file.recorder.close()
        return [(file.recorder.path, file.frames * _FRAME_S) for file in self._files.values()]

    def _open(self, texture: int) -> "_TextureFile":
        name, model = self._names[texture], self._models[texture]
        recorder = McapRecorder(
            self.path_of(texture),
            channels=CHANNELS,
            existing=self._existing,
            samples_per_frame=self._samples,
        )
        recorder.attach_model(model.to_bytes, 0.0)
        recorder.record_event({"time_s": 0.0, "event": f"{name} is played", "texture": name})
        return _TextureFile(recorder, self._samples)


class _TextureFile:
    """The session of one texture."""

    def __init__(self, recorder: McapRecorder, samples_per_frame: int) -> None:
        self.recorder = recorder
        self._samples = samples_per_frame
        self.frames = 0
        self._sequence = -1
        self._path_mm = np.zeros(2)

    def begin(self, step: Step) -> None:
        """Begin another touch at the position of the hand."""
        self._sequence += 1
        self._path_mm = np.array([step.x_mm, step.y_mm])

    def write(self, step: Step, vibration_m_s2: FloatArray) -> None:
        count = len(vibration_m_s2) // self._samples
        frames = empty_frames(count, samples_per_frame=self._samples)
        frames["sequence"] = self._sequence + np.arange(count)
        frames["time_ns"] = frames["sequence"].astype(np.int64) * FRAME_PERIOD_NS
        back = (np.array([step.x_mm, step.y_mm]) - self._path_mm) / _RETURN_S
        step_mm = (np.array([step.x_mm_s, step.y_mm_s]) + back) * _FRAME_S
        counted = np.arange(1, count + 1)[:, None]
        frames["position_mm"][:, :2] = self._path_mm + counted * step_mm
        frames["force_n"][:, 2] = step.force_n
        along = frames["acceleration_m_s2"][..., 2]
        along[:] = vibration_m_s2.reshape(along.shape)
        self._path_mm = self._path_mm + count * step_mm
        self._sequence += count
        self.frames += count
        self.recorder.record_frames(frames)
