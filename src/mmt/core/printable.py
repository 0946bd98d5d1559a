"""Remove terminal control characters, and secrets in URLs, from untrusted text."""

import re
from typing import Final

_PLACEHOLDER = "\N{REPLACEMENT CHARACTER}"
_SECRETS: Final = re.compile(r"(?<=://)\S*(?=@)|(?<=[?&]password=)[^&\s'\"]*")
"""User and password of a URL, before its host or in its query."""


def printable(text: str, keep: str = "") -> str:
    """Return a text with a placeholder for each character that cannot be printed.

    This removes terminal escapes, line ends and direction marks that a peer, a device or a file
    may contain.

    Parameters
    ----------
    text
        Any text.
    keep
        Characters to keep even if they are not printable.
    """
    return "".join(c if c.isprintable() or c in keep else _PLACEHOLDER for c in text)


def without_secrets(text: str) -> str:
    """Return a text without the users and passwords of the URLs in it."""
    return _SECRETS.sub("***", text)
