"""Changes of a shared model: what differs between two states, and a copy kept up to date.

Here a model is the arrays of its file (`mmt.texture.model.file_arrays`). Most arrays have a row for
each sample, or for each cell of the field. While a model grows, few rows are added, removed or
changed. So a difference names the rows that stay and contains the new ones. All other arrays are
short; the difference contains those that have changed.

A difference consists of numbers, strings, bytes, lists and maps, which msgpack can pack. Applied to
the earlier state, it gives the arrays of the later one to the bit; a digest verifies that. Cost:
O(bytes of the model), some 0.2 ms for 200 samples.
"""

import re
from collections.abc import Mapping
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.model.file_arrays import FIELD_ROWS, MODEL_ROWS, file_arrays, pack_arrays
from mmt_share.messages import MODEL, ModelDescription

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel

Arrays = Mapping[str, Any]
"""The arrays of a model by name."""

_GROUPS: Final = (MODEL_ROWS, FIELD_ROWS)
_NEW: Final = -1
"""Marks an entry of a plan as new rows, in place of the first earlier row."""
_LARGEST_BYTES: Final = 16 << 20
_DTYPE: Final = re.compile("[<>|][fiuU][0-9]+")


def digest(arrays: Arrays) -> bytes:
    """Return an 8-byte hash of the arrays' names, dtypes, shapes and values."""
    found = blake2b(digest_size=8)
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        found.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.digest()


def difference(before: Arrays, after: Arrays) -> dict[str, Any]:
    """Return the difference from one state of a model's arrays to another.

    Returns
    -------
    dict
        ``arrays``: new and changed arrays by name, each as dtype (NumPy's name), shape and bytes.
        ``rows``: for each group of arrays with common rows their ``names`` and a ``plan``, a list
        of ``[first, stop]`` for earlier rows, or ``[-1, n]`` for the next n new rows, which
        ``arrays`` contains. ``gone``: names of removed arrays. ``digest``: hash of the result.
    """
    held: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    grouped: set[str] = set()
    for group in _GROUPS:
        names = [name for name in group if name in after]
        if names and _alike(before, after, names):
            plan, new = _plan(before, after, names)
            rows.append({"names": names, "plan": plan})
            held |= {name: _packed(np.asarray(after[name])[new]) for name in names if len(new)}
            grouped.update(names)
    for name in after.keys() - grouped:
        if name not in before or _packed(before[name]) != _packed(after[name]):
            held[name] = _packed(after[name])
    gone = sorted(before.keys() - after.keys())
    return {"arrays": held, "rows": rows, "gone": gone, "digest": digest(after)}


def apply(before: Arrays, change: object) -> dict[str, Any]:
    """Return the arrays of the new state of a model.

    Parameters
    ----------
    before
        Arrays of the earlier state.
    change
        Result of `difference`, which is not trusted.

    Raises
    ------
    InputError
        The change is malformed, or does not belong to this earlier state.
    """
    try:
        arrays = _applied(before, change)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, AttributeError) as error:
        raise InputError(f"the change of a model is malformed: {error}") from error
    if digest(arrays) != change["digest"]:  # type: ignore[index] # it has one by now
        raise InputError("the change of a model belongs to another state of it")
    return arrays


def _applied(before: Arrays, change: Any) -> dict[str, Any]:
    if not isinstance(change["digest"], bytes):
        raise TypeError("digest")
    gone = set(change["gone"])
    arrays = {name: array for name, array in before.items() if name not in gone}
    held = {str(name): _unpacked(packed) for name, packed in change["arrays"].items()}
    for group in change["rows"]:
        for name in group["names"]:
            earlier = np.asarray(arrays[name])
            new = held.pop(name, earlier[:0])
            arrays[name] = _rows_by(group["plan"], earlier, new)
    return arrays | held


def _alike(before: Arrays, after: Arrays, names: list[str]) -> bool:
    """Say whether rows of the two states can be compared."""
    return all(
        name in before
        and np.asarray(before[name]).dtype == np.asarray(after[name]).dtype
        and np.asarray(before[name]).shape[1:] == np.asarray(after[name]).shape[1:]
        for name in names
    )


def _plan(before: Arrays, after: Arrays, names: list[str]) -> tuple[list[list[int]], list[int]]:
    """Return the plan of a group of arrays, and the numbers of the new rows in the new state."""
    where = {row: index for index, row in enumerate(_rows(before, names))}
    plan: list[list[int]] = []
    new: list[int] = []
    for index, row in enumerate(_rows(after, names)):
        earlier = where.get(row)
        if earlier is None:
            new.append(index)
            if plan and plan[-1][0] == _NEW:
                plan[-1][1] += 1
            else:
                plan.append([_NEW, 1])
        elif plan and plan[-1][0] != _NEW and plan[-1][1] == earlier:
            plan[-1][1] += 1
        else:
            plan.append([earlier, earlier + 1])
    return plan, new


def _rows(arrays: Arrays, names: list[str]) -> list[bytes]:
    """Return each row of the arrays (n, ...), joined, as bytes."""
    columns = [np.ascontiguousarray(arrays[name]) for name in names]
    parts = [column.reshape(len(column), -1).view(np.uint8) for column in columns]
    return [row.tobytes() for row in np.hstack(parts)]


def _rows_by(plan: Any, earlier: FloatArray, new: FloatArray) -> FloatArray:
    parts, used = [earlier[:0]], 0
    for first, stop in plan:
        if first == _NEW:
            if not 0 < stop <= len(new) - used:
                raise ValueError(f"{stop} new rows")
            parts.append(new[used : used + stop])
            used += stop
        else:
            if not 0 <= first < stop <= len(earlier):
                raise ValueError(f"rows {first} to {stop} of {len(earlier)}")
            parts.append(earlier[first:stop])
    if sum(part.nbytes for part in parts) > _LARGEST_BYTES:
        raise ValueError("it is too large")
    return np.concatenate(parts)


def _packed(array: Any) -> list[Any]:
    array = np.asarray(array)
    return [array.dtype.str, list(array.shape), np.ascontiguousarray(array).tobytes()]


def _unpacked(packed: Any) -> FloatArray:
    kind, shape, data = packed
    if not _DTYPE.fullmatch(str(kind)):
        raise ValueError(f"dtype {kind}")
    lengths = [int(length) for length in shape]
    if min(lengths, default=0) < 0:
        raise ValueError(f"shape {lengths}")
    return np.frombuffer(data, kind).reshape(lengths)


class ModelReplica:
    """The newest state of a shared model that has arrived.

    Attributes
    ----------
    about
        Description of this state, or None before the first.
    """

    def __init__(self) -> None:
        self.about: ModelDescription | None = None
        self._arrays: dict[str, Any] = {}

    @property
    def number(self) -> int:
        """Number of this state, 0 before the first."""
        return 0 if self.about is None else self.about.number

    def take(self, event: str, message: object) -> None:
        """Take a whole model (`MODEL`), or the change (`CHANGE`) of the state that is here.

        Raises
        ------
        InputError
            The message is malformed, or changes another state; then the whole model must be
            requested. The replica stays as it was.
        """
        about = ModelDescription.from_message(message)
        given: Mapping[str, Any] = message  # type: ignore[assignment] # it is a map by now
        if event == MODEL:
            file = given.get("file")
            if not isinstance(file, bytes):
                raise InputError("the model's message has no file")
            arrays = file_arrays(file)
        else:
            since = given.get("since")
            if since != self.number or not self.number:
                raise InputError(f"a change since number {since} came to number {self.number}")
            arrays = apply(self._arrays, given)
        self._arrays, self.about = arrays, about

    def message(self) -> dict[str, Any]:
        """Return the message of the whole model; the compression takes some 5 ms.

        Raises
        ------
        InputError
            No model has come yet.
        """
        if self.about is None:
            raise InputError("no model has come yet")
        return {**vars(self.about), "file": pack_arrays(self._arrays)}

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
