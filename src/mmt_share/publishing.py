"""Messages for each new state of a model: the whole model, and the change."""

import time
from typing import Any, NamedTuple

from mmt.link.protocol import encode_event
from mmt.texture.model.file import arrays_of
from mmt.texture.model.file_arrays import pack_arrays
from mmt.texture.model.texture_model import TextureModel
from mmt_share.difference import difference
from mmt_share.messages import MODEL, ModelDescription, encode_change, model_message


class PublishedModel(NamedTuple):
    """One state of a model for the wire: its number and its two messages."""

    number: int
    whole: bytes
    change: bytes | None
    """Change from the state before, or None for the first state."""


class ModelPublisher:
    """Make the messages of each new state of a model.

    Call it in a worker thread: it takes some 5 ms for 200 samples, most of it to compress the
    whole model.
    """

    def __init__(self) -> None:
        self._number = 0
        self._arrays: dict[str, Any] = {}

    def publish(self, model: TextureModel, about: ModelDescription) -> PublishedModel:
        """Return the messages of a model's new state."""
        before, after = self._arrays, arrays_of(model.contents)
        self._arrays = after
        self._number += 1
        now_ns = time.monotonic_ns()
        change = None
        if before:
            change = encode_change(self._number, now_ns, about, difference(before, after))
        whole = model_message(self._number, now_ns, about, pack_arrays(after))
        return PublishedModel(self._number, encode_event(MODEL, whole), change)
