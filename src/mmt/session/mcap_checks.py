"""What is asked of an MCAP file before it counts as a session."""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import zstandard
from mcap.exceptions import McapError
from mcap.records import Schema

from mmt.core.errors import InputError
from mmt.session.mcap_writer import FORMAT_VERSION, FRAMES_TOPIC
from mmt.session.messages import FRAME_BLOCK

DAMAGE: Final = (McapError, struct.error, ValueError, zstandard.ZstdError)
"""What the MCAP library raises on bytes that make no sense; ValueError holds its CRC and
Unicode errors."""


def frame_schema(
    path: Path, schemas: Mapping[str, Schema | None], metadata: Mapping[str, str]
) -> bytes:
    """Return the schema of a file's frames.

    Parameters
    ----------
    path
        Of the file.
    schemas
        By topic.
    metadata
        Of the session.

    Raises
    ------
    InputError
        The file is no session, or of a newer version.
    """
    schema = schemas.get(FRAMES_TOPIC)
    if schema is None or schema.name != FRAME_BLOCK:
        raise InputError(
            f"session {path}: an MCAP file without the topic {FRAMES_TOPIC} of "
            f"{FRAME_BLOCK}; its topics: {', '.join(sorted(schemas)) or 'none'}"
        )
    version = metadata.get("format_version", "1")
    if not version.isdecimal() or int(version) > FORMAT_VERSION:
        raise InputError(
            f"session {path}: format version {version}, this program reads up to "
            f"{FORMAT_VERSION}; update mmt-haptics"
        )
    return bytes(schema.data)


def parse_json(path: Path, text: str | bytes, what: str) -> dict[str, Any]:
    """Return a JSON object out of a file.

    Raises
    ------
    InputError
        The text is none.
    """
    try:
        value = json.loads(text)
    except ValueError as error:
        raise InputError(f"session {path}: {what} is not valid JSON: {error}") from error
    if not isinstance(value, dict):
        raise InputError(f"session {path}: {what} is no JSON object")
    return value
