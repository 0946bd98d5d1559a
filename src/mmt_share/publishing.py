"""A model as its leader publishes it: numbered, whole and as what has changed."""

import time
from typing import Any, NamedTuple

from mmt.link.protocol import encode_event
from mmt.texture.model.file import arrays_of
from mmt.texture.model.file_arrays import pack_arrays
from mmt.texture.model.texture_model import TextureModel
from mmt_share.difference import difference
from mmt_share.messages import MODEL, About, encode_change, model_message


class PublishedModel(NamedTuple):
    """One state of a model for the wire: its number, and either way to bring it over."""

    number: int
    whole: bytes
    change: bytes | None
    """From the number before; None for the first one."""


class ModelPublisher:
    """Make the messages of each new state of a model.

    Cost: some 5 ms for 200 samples, most of it for the compression of the whole; to be called in
    a worker thread.
    """

    def __init__(self) -> None:
        self._number = 0
        self._arrays: dict[str, Any] = {}

    def publish(self, model: TextureModel, about: About) -> PublishedModel:
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
