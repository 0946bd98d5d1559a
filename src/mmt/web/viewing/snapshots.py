"""Every state that a model had, on disk, so that an hour of them fills no memory."""

import tempfile
import threading
from functools import lru_cache
from typing import Final

from mmt.texture.model.texture_model import TextureModel

_MODELS_KEPT: Final = 8
"""In memory, of those asked for last."""


class ModelSnapshots:
    """Models by number, in an anonymous file that is gone when it is closed.

    One thread adds, another one asks.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="mmt-models-")  # noqa: SIM115 - see `close`
        self._places: list[tuple[int, int]] = []
        self._lock = threading.Lock()
        self.model = lru_cache(_MODELS_KEPT)(self._read)
        """Return the model of a number."""

    def __len__(self) -> int:
        return len(self._places)

    def add(self, model: TextureModel) -> int:
        """Keep a model; return its number. Some kilobytes, 100 of the largest model."""
        data = model.to_bytes()
        with self._lock:
            place = self._file.seek(0, 2)
            self._file.write(data)
            self._places.append((place, len(data)))
            return len(self._places) - 1

    def close(self) -> None:
        """Forget them all."""
        with self._lock:
            self._file.close()

    def _read(self, number: int) -> TextureModel:
        with self._lock:
            place, size = self._places[number]
            self._file.seek(place)
            data = self._file.read(size)
        return TextureModel.from_bytes(data)
