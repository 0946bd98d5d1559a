"""What has changed from one state of a model to the next, as few bytes as it takes.

A model is the arrays of its file (`mmt.texture.model.file_arrays`). Most of them have a row for
each sample, or for each cell of the field. While a model grows a few rows come, and a few go or
change; so a difference names the rows that stay and holds the others. All other arrays are short,
and are held where they are new.

A difference is plain numbers, strings, bytes, lists and maps, as msgpack takes them. Applied to
what it was made from, it gives the arrays of the new state to the bit; a digest tells whether it
was. Cost: O(bytes of the model), some 0.2 ms for 200 samples.
"""

from collections.abc import Mapping
from hashlib import blake2b
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.model.file_arrays import FIELD_ROWS, MODEL_ROWS

Arrays = Mapping[str, Any]
"""The arrays of a model by name."""

_GROUPS: Final = (MODEL_ROWS, FIELD_ROWS)
_NEW: Final = -1
"""In a plan, in place of a first row: rows that the difference holds."""
_LARGEST_BYTES: Final = 16 << 20
_KINDS: Final = "fiuU"


def digest(arrays: Arrays) -> bytes:
    """Return 8 bytes that arrays of other names, kinds, shapes or values hardly share."""
    found = blake2b(digest_size=8)
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        found.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.digest()


def difference(before: Arrays, after: Arrays) -> dict[str, Any]:
    """Return what leads from the arrays of one state of a model to those of another.

    Returns
    -------
    dict
        ``arrays``: those that are new or have changed, by name: dtype (NumPy's name), shape and
        bytes. ``rows``: for each kind of rows the ``plan``, a list of ``[first, stop]`` of the
        earlier rows, or ``[-1, n]`` for the next n of the new rows, which ``arrays`` holds; and
        the ``names`` of the arrays that it is for. ``gone``: names that are no more. ``digest``:
        of the result.
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
        What `difference` returned, which is not trusted.

    Raises
    ------
    InputError
        It is malformed, or does not belong to this earlier state.
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
    """Return all that arrays (n, ...) say of each row, as bytes."""
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
    dtype = np.dtype(str(kind))
    if dtype.kind not in _KINDS:
        raise ValueError(f"dtype {kind}")
    lengths = [int(length) for length in shape]
    if min(lengths, default=0) < 0:
        raise ValueError(f"shape {lengths}")
    return np.frombuffer(data, dtype).reshape(lengths)
