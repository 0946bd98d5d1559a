"""Text from elsewhere without what a terminal would obey."""

import re
from typing import Final

_PLACEHOLDER = "\N{REPLACEMENT CHARACTER}"
_SECRETS: Final = re.compile(r"(?<=://)\S*(?=@)|(?<=[?&]password=)[^&\s'\"]*")
"""User and password of a URL, as its host or its query has them."""


def printable(text: str, keep: str = "") -> str:
    """Return a text with a placeholder for each character that cannot be printed.

    That takes terminal escapes, line ends and marks of direction out of what a peer, a device or
    a file may contain.

    Parameters
    ----------
    text
        Any text.
    keep
        Characters that stay nevertheless.
    """
    return "".join(c if c.isprintable() or c in keep else _PLACEHOLDER for c in text)


def without_secrets(text: str) -> str:
    """Return a text without the users and passwords of the URLs in it."""
    return _SECRETS.sub("***", text)
