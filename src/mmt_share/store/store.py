"""A folder of texture models with descriptions: the shared library of a lab.

A model is named by the SHA-256 of its file, so that it is stored once even if several people add
it, and a client can verify what it has fetched. Beside each ``HASH.npz`` is a ``HASH.json`` with
its `Entry`.
"""

import hashlib
import json
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import ConfigDict, Field, FiniteFloat

from mmt.core.bounds import finite_number
from mmt.core.errors import InputError, MmtError, printable
from mmt.core.files.existing import write_file
from mmt.core.files.untrusted import parsed_json
from mmt.texture.model.file import unpack
from mmt_share.messages import LONGEST_TEXT, PeerMessage, Text

LARGEST_BYTES: Final = 1 << 20
"""Most bytes of a model file; one of a thousand samples has some 200,000."""

MOST_MODELS: Final = 1000
HASH: Final = "[0-9a-f]{64}"
"""Pattern of a hash."""


@dataclass(frozen=True)
class Entry(PeerMessage):
    """Description of a model.

    Attributes
    ----------
    name
        Name for people.
    who, licence, note
        Who made it, the terms under which it may be used, and a remark; may be empty.
    made
        Date and time (ISO 8601, UTC) at which it came into the store.
    error_db
        Power error over the whole plane, or None if the true texture is not known.
    hash, file_bytes, inputs, samples, order, rate_hz
        Properties of the file.
    """

    title = "what is listed of a model"
    may_lack = True
    __pydantic_config__ = ConfigDict(extra="forbid")

    name: Text
    who: Text = ""
    licence: Text = ""
    note: Text = ""
    made: Text = ""
    error_db: FiniteFloat | None = None
    hash: Annotated[str, Field(pattern=f"^{HASH}$", validate_default=True)] = ""
    file_bytes: int = 0
    inputs: Text = ""
    samples: int = 0
    order: int = 0
    rate_hz: FiniteFloat = 0.0

    @classmethod
    def from_description(cls, description: Mapping[str, str]) -> Self:
        """Parse a person's description of a model, which is not trusted; other fields stay empty.

        Raises
        ------
        InputError
            There is no name, or ``error_db`` is not a number.
        """
        name, who, licence, note = (
            printable(description.get(key, "")[:LONGEST_TEXT])
            for key in ("name", "who", "licence", "note")
        )
        if not name.strip():
            raise InputError("the model has no name: give it one")
        text = description.get("error_db")
        try:
            error_db = None if text is None else finite_number(text)
        except ValueError as error:
            raise InputError(f"error_db is {text!r}: it must be a finite number") from error
        return cls(name, who, licence, note, error_db=error_db)


class ModelStore:
    """The models in a folder.

    Parameters
    ----------
    folder
        Created with the first model if it does not exist.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def entries(self) -> list[Entry]:
        """Return the entries of all models, the newest first; damaged ones are left out."""
        found = []
        for path in self.folder.glob("*.json") if self.folder.is_dir() else ():
            entry = _read(path)
            if entry is not None and self.path(entry.hash) is not None:
                found.append(entry)
        return sorted(found, key=lambda entry: (entry.made, entry.name), reverse=True)

    def path(self, digest: str) -> Path | None:
        """Return the file of the model with this hash, or None if there is none."""
        if not re.fullmatch(HASH, digest):
            return None
        path = self.folder / f"{digest}.npz"
        return path if path.is_file() else None

    def add(self, data: bytes, said: Entry) -> Entry:
        """Add a model file; a model that is in the store already stays as it is.

        Raises
        ------
        InputError
            The data is not a model or too large, or the store is full.
        MmtError, OSError
            The model cannot be written.
        """
        if len(data) > LARGEST_BYTES:
            raise InputError(f"the model has {len(data)} bytes: {LARGEST_BYTES} are allowed")
        contents = unpack(data)
        contents.samples.check()
        digest = hashlib.sha256(data).hexdigest()
        about = self.folder / f"{digest}.json"
        before = _read(about) if self.path(digest) is not None else None
        if before is not None:
            return before
        if len(list(self.folder.glob("*.json"))) >= MOST_MODELS:
            raise InputError(f"the store has {MOST_MODELS} models: it takes no more")
        entry = replace(
            said,
            made=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            hash=digest,
            file_bytes=len(data),
            inputs=contents.samples.space.name,
            samples=len(contents.samples),
            order=int(contents.samples.lsf.shape[1]),
            rate_hz=contents.rate_hz,
        )
        try:
            write_file(self.folder / f"{digest}.npz", data)
            write_file(about, json.dumps(vars(entry), indent=1))
        except InputError as error:  # the fault of the folder, not of the model
            raise MmtError(str(error)) from error
        return entry


def _read(path: Path) -> Entry | None:
    """Read the entry beside a model; return None if it is damaged."""
    try:
        return Entry.from_message(parsed_json(path.read_bytes(), "it"))
    except (OSError, InputError):
        return None
