"""Read files from untrusted sources: what is damaged, expands, or is not there is refused."""

import io
import json
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from tokenize import TokenError
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.errors import InputError, short_message

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_DAMAGE: Final = (
    *(ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error),
    *(SyntaxError, TokenError, OverflowError, RecursionError),  # in the header of an array
    MemoryError,  # a shape that is larger than the machine
    NotImplementedError,  # a compression that Python does not know
    RuntimeError,  # an encrypted member
)
"""Errors from reading an archive that is damaged or was not made by NumPy."""

_LARGEST_BYTES = 512 << 20
_LARGEST_RATIO = 100
"""An archive may unpack to this many times its size, or to `_LARGEST_BYTES` if that is more."""

_LFS_POINTER: Final = b"version https://git-lfs.github.com/spec/"

Arrays = dict[str, np.ndarray[Any, np.dtype[Any]]]


def require_fetched(path: Path) -> None:
    """Refuse the pointer that Git LFS puts in place of a file that it has not fetched.

    Raises
    ------
    InputError
        The file is such a pointer.
    OSError
        It cannot be read.
    """
    with path.open("rb") as stream:
        if stream.read(len(_LFS_POINTER)) == _LFS_POINTER:
            raise InputError(
                "this is only Git LFS's pointer to the file, which was not fetched: git lfs pull "
                "fetches it"
            )


def parsed_json(text: str | bytes, what: str) -> Any:
    """Parse JSON from a file; `what` names it in messages.

    Raises
    ------
    InputError
        The text is not JSON.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{what} is not valid JSON: {error}") from error


def json_object(text: str | bytes, what: str) -> dict[str, Any]:
    """Parse a JSON object from a file; `what` names it in messages.

    Raises
    ------
    InputError
        The text is not a JSON object.
    """
    value = parsed_json(text, what)
    if not isinstance(value, dict):
        raise InputError(f"{what} is not a JSON object")
    return value


def load_arrays(
    source: Path | bytes, wanted: Callable[[str], bool] | None = None
) -> tuple[Arrays, list[str]]:
    """Return the wanted arrays of a ``.npz`` archive by name, and the names of all its arrays.

    Raises
    ------
    InputError
        The source is not an archive of plain arrays, or unpacks to far more than its size. The
        message does not name the file.
    OSError
        The file cannot be read.
    """
    stream = io.BytesIO(source) if isinstance(source, bytes) else source.open("rb")
    try:
        with stream:
            _check_size(stream)
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                raise InputError("this is a single array, not a .npz archive")
            with loaded as archive:
                names = [name for name in archive.files if wanted is None or wanted(name)]
                return {name: archive[name] for name in names}, list(archive.files)
    except _DAMAGE as error:
        raise InputError(
            f"this is not a .npz archive of numbers: {short_message(error)}"
        ) from error


def _check_size(stream: Any) -> None:
    """Refuse an archive that unpacks to far more than its size."""
    if not zipfile.is_zipfile(stream):
        stream.seek(0)
        return
    with zipfile.ZipFile(stream) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    if unpacked > max(_LARGEST_BYTES, _LARGEST_RATIO * size):
        raise InputError(
            f"it unpacks to {unpacked / 1e6:.0f} MB from {size / 1e6:.3g} MB, which no recording "
            "or model does"
        )


def parse_xml(content: bytes) -> "Element":
    """Return the root of a document without document type: entities can expand without bound.

    Raises
    ------
    InputError
        The content is no XML, is in an unknown encoding, or declares a document type; the
        message does not name the file.
    """
    import xml.etree.ElementTree as ET

    class PlainBuilder(ET.TreeBuilder):
        """Refuses a document type as soon as one is met, whatever the text's encoding."""

        def doctype(self, *_: object) -> None:
            """Refuse the document type before an entity is declared."""
            raise InputError("it declares a document type, which no such file does")

    parser = ET.XMLParser(target=PlainBuilder())  # noqa: S314 - without entities
    try:
        parser.feed(content)
        root: Element = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:  # of odd encodings as well
        raise InputError(f"it is no XML: {short_message(error)}") from error
    return root
