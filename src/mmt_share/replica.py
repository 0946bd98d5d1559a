"""A listener's copy of a shared model, kept up to date by messages that are not trusted."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mmt.core.errors import InputError
from mmt.texture.model.file_arrays import file_arrays, pack_arrays
from mmt_share.difference import apply
from mmt_share.messages import ModelDescription, model_message

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel


class ModelReplica:
    """The newest state of a shared model that has arrived.

    Attributes
    ----------
    number
        Number of this state, 0 before the first.
    made_ns
        When this state was made, by the leader's monotonic clock.
    about
        Description of this state, or None before the first.
    """

    def __init__(self) -> None:
        self.number = self.made_ns = 0
        self.about: ModelDescription | None = None
        self._arrays: dict[str, Any] = {}

    def replace_model(self, message: object) -> None:
        """Take a whole model.

        Raises
        ------
        InputError
            The message is malformed; the replica stays as it was.
        """
        stamp, about = _stamp(message), ModelDescription.from_message(message)
        file = message.get("file") if isinstance(message, Mapping) else None
        if not isinstance(file, bytes):
            raise InputError("the model's message has no file")
        self._arrays = file_arrays(file)
        (self.number, self.made_ns), self.about = stamp, about

    def apply_change(self, message: object) -> None:
        """Apply a change to the state that is here.

        Raises
        ------
        InputError
            The change is malformed, or from another state. The replica stays as it was, and the
            whole model must be requested.
        """
        stamp, about = _stamp(message), ModelDescription.from_message(message)
        since = message.get("since") if isinstance(message, Mapping) else None
        if since != self.number or not self.number:
            raise InputError(f"a change since number {since} came to number {self.number}")
        self._arrays = apply(self._arrays, message)
        (self.number, self.made_ns), self.about = stamp, about

    def message(self) -> dict[str, Any]:
        """Return the message of the whole model; the compression takes some 5 ms.

        Raises
        ------
        InputError
            No model has come yet.
        """
        if self.about is None:
            raise InputError("no model has come yet")
        return model_message(self.number, self.made_ns, self.about, pack_arrays(self._arrays))

    def build(self) -> "TextureModel":
        """Build the model, from any thread; this takes some 30 ms.

        Raises
        ------
        InputError
            The arrays do not form a model.
        """
        # imported here: a hub passes models on and builds none
        from mmt.texture.model.file import contents_of
        from mmt.texture.model.texture_model import TextureModel

        return TextureModel.from_contents(contents_of(self._arrays))


def _stamp(message: object) -> tuple[int, int]:
    """Return the number of the model in a message, and when it was made."""
    match message:
        case {"number": int(number), "made_ns": int(made_ns)} if number >= 1:
            return number, made_ns
    raise InputError("the model's message has no number, or no time")
