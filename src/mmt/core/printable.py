"""Text from elsewhere without what a terminal would obey."""

_PLACEHOLDER = "\N{REPLACEMENT CHARACTER}"


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
