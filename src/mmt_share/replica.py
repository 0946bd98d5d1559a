"""A listener's copy of a shared model, kept up to date by messages that are not trusted."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mmt.core.errors import InputError
from mmt.texture.model.file_arrays import file_arrays, pack_arrays
from mmt_share.difference import apply
from mmt_share.messages import About, model_message

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel


class ModelReplica:
    """The newest state of a shared model that has arrived.

    Attributes
    ----------
    number
        Its number, 0 before the first.
    made_ns
        When it was made, by the leader's monotonic clock.
    about
        What was said of it, None before the first.
    """

    def __init__(self) -> None:
        self.number = self.made_ns = 0
        self.about: About | None = None
        self._arrays: dict[str, Any] = {}

    def take_whole(self, message: object) -> None:
        """Take a whole model.

        Raises
        ------
        InputError
            The message is malformed; the replica stays what it was.
        """
        stamp, about = _stamp(message), About.from_message(message)
        file = message.get("file") if isinstance(message, Mapping) else None
        if not isinstance(file, bytes):
            raise InputError("the model's message has no file")
        self._arrays = file_arrays(file)
        (self.number, self.made_ns), self.about = stamp, about

    def take_change(self, message: object) -> None:
        """Take what has changed since the state that is here.

        Raises
        ------
        InputError
            It is malformed, or begins at another state; the replica stays what it was, and the
            whole model must be asked for.
        """
        stamp, about = _stamp(message), About.from_message(message)
        since = message.get("since") if isinstance(message, Mapping) else None
        if since != self.number or not self.number:
            raise InputError(f"a change since number {since} came to number {self.number}")
        self._arrays = apply(self._arrays, message)
        (self.number, self.made_ns), self.about = stamp, about

    def message(self) -> dict[str, Any]:
        """Return the message of the whole model as it is here; some 5 ms, for its compression.

        Raises
        ------
        InputError
            There is none yet.
        """
        if self.about is None:
            raise InputError("no model has come yet")
        return model_message(self.number, self.made_ns, self.about, pack_arrays(self._arrays))

    def build(self) -> "TextureModel":
        """Return the model; some 30 ms, from any thread.

        Raises
        ------
        InputError
            The arrays are no model.
        """
        # a hub hands models on and renders none
        from mmt.texture.model.file import contents_of
        from mmt.texture.model.texture_model import TextureModel

        return TextureModel.from_contents(contents_of(self._arrays))


def _stamp(message: object) -> tuple[int, int]:
    """Return the number of a message's model, and when it was made."""
    match message:
        case {"number": int(number), "made_ns": int(made_ns)} if number >= 1:
            return number, made_ns
    raise InputError("the model's message has no number, or no time")
