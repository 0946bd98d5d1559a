"""Record a pointer's touches as sessions that the evaluation reads, one for each texture.

A session's time is that of touching its texture. Where the pointer is put down anew, one frame's
number is left out, so that filters start anew there, as between trials.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.existing_files import require_absent
from mmt.core.frames import CHANNELS, empty_frames
from mmt.rendering.rate import RateConverter
from mmt.session.data import FRAME_PERIOD_NS
from mmt.session.recorder import Existing, McapRecorder
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.motion import PointerMotion

_FRAME_S: Final = FRAME_PERIOD_NS / 1e9
_RETURN_S: Final = 1.0
"""Time constant by which the recorded path, which is the integral of the velocity that was
rendered, returns to the pointer."""


class TouchRecorder:
    """Write a session for each texture that is touched.

    Parameters
    ----------
    path
        The file; with several textures, each one's name is put behind the stem.
    names, models
        The textures.
    render_hz
        Sampling rate (Hz) of the vibration given to `record`.
    replace
        Whether files that exist are replaced.

    Raises
    ------
    InputError
        One of the files exists and is not to be replaced.
    """

    def __init__(
        self,
        path: str | Path,
        names: Sequence[str],
        models: Sequence[TextureModel],
        render_hz: float,
        *,
        replace: bool = False,
    ) -> None:
        self._path = Path(path)
        self._names = tuple(names)
        self._models = tuple(models)
        self._files: dict[int, _TextureFile] = {}
        self._render_hz = render_hz
        self._down: _TextureFile | None = None
        self._refusal: str | None = None
        self._converter = RateConverter(render_hz, 1.0 / _FRAME_S)
        self._existing: Existing = "replace" if replace else "refuse"
        for texture in range(len(names)):
            require_absent(self.path_of(texture), force=replace)

    def path_of(self, texture: int) -> Path:
        """Return the file of a texture's session."""
        if len(self._names) == 1:
            return self._path
        return self._path.with_name(f"{self._path.stem}-{self._names[texture]}{self._path.suffix}")

    @property
    def seconds(self) -> float:
        """How long textures were touched."""
        return sum(file.frames for file in self._files.values()) * _FRAME_S

    @property
    def problem(self) -> str | None:
        """Why a recording stopped, None while all is well."""
        if self._refusal is not None:
            return self._refusal
        for file in self._files.values():
            if file.recorder.error is not None:
                return f"recording {file.recorder.path}: {file.recorder.error}"
        return None

    def lift(self) -> None:
        """End the touch: the next one starts anew."""
        self._down = None

    def record(self, texture: int, motion: PointerMotion, vibration_m_s2: FloatArray) -> None:
        """Record the touch of a texture for as long as these samples (n,) last.

        If a file cannot be created, `problem` says so, and nothing more is recorded.
        """
        if self._refusal is not None:
            return
        file = self._files.get(texture)
        if file is None:
            try:
                file = self._files[texture] = self._open(texture)
            except InputError as error:
                self._refusal = str(error)
                return
        if file is not self._down:
            self._down = file
            file.begin(motion)
            self._converter = RateConverter(self._render_hz, 1.0 / _FRAME_S)
        file.write(motion, self._converter.convert(vibration_m_s2))

    def close(self) -> list[tuple[Path, float]]:
        """End the files; return each with its seconds."""
        for file in self._files.values():
            file.recorder.close()
        return [(file.recorder.path, file.frames * _FRAME_S) for file in self._files.values()]

    def _open(self, texture: int) -> "_TextureFile":
        name, model = self._names[texture], self._models[texture]
        recorder = McapRecorder(self.path_of(texture), channels=CHANNELS, existing=self._existing)
        recorder.attach_model(model.to_bytes(), 0.0)
        recorder.record_event({"time_s": 0.0, "event": f"{name} is played", "texture": name})
        return _TextureFile(recorder)


class _TextureFile:
    """The session of one texture."""

    def __init__(self, recorder: McapRecorder) -> None:
        self.recorder = recorder
        self.frames = 0
        self._sequence = -1
        self._path_mm = np.zeros(2)

    def begin(self, motion: PointerMotion) -> None:
        """Begin another touch, from where the pointer is."""
        self._sequence += 1
        self._path_mm = np.array(motion.position_mm)

    def write(self, motion: PointerMotion, vibration_m_s2: FloatArray) -> None:
        count = len(vibration_m_s2)
        frames = empty_frames(count)
        frames["sequence"] = self._sequence + np.arange(count)
        frames["time_ns"] = frames["sequence"].astype(np.int64) * FRAME_PERIOD_NS
        back = (np.array(motion.position_mm) - self._path_mm) / _RETURN_S
        step_mm = (np.array(motion.velocity_mm_s) + back) * _FRAME_S
        steps = np.arange(1, count + 1)[:, None]
        frames["position_mm"][:, :2] = self._path_mm + steps * step_mm
        frames["force_n"][:, 2] = motion.force_n
        frames["acceleration_m_s2"][:, 2] = vibration_m_s2
        self._path_mm = self._path_mm + count * step_mm
        self._sequence += count
        self.frames += count
        self.recorder.record_frames(frames)
