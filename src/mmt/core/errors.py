"""Errors whose message is shown to the user, and untrusted text made fit to be shown."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from traceback import walk_tb
from typing import Final

FAILED: Final = "failed: "
"""Prefix of the outcome of a service that a fault has ended, and of the reason sent to its peer,
which then ends as failed too."""

_LONGEST_TEXT = 200
_PLACEHOLDER = "\N{REPLACEMENT CHARACTER}"
_PASSED: Final = re.compile(r"mmt(_bridges|_devices|_lab|_methods|_share)?|importlib|_frozen_.*")
"""Packages whose lines of code are not told."""
_SECRETS: Final = re.compile(r"(?<=://)\S*(?=@)|(?<=[?&]password=)[^&\s'\"]*")
"""User and password of a URL, before its host or in its query."""


class MmtError(Exception):
    """An error that can be explained to the user in a sentence.

    The command line prints the message alone, without a traceback, and exits with
    `exit_code`: 1 the run failed, 2 bad usage or input.
    """

    exit_code = 1


class InputError(MmtError):
    """Input that cannot be used: a file, a value, a combination of keys."""

    exit_code = 2


class SettingError(InputError, ValueError):
    """A setting that is not allowed.

    Also a `ValueError`, so that pydantic includes the message in its own, which names the table.
    """


class DeviceLost(MmtError):  # noqa: N818 - it is what has happened to the device
    """A device that worked before no longer answers; it may be connected again later."""


@contextmanager
def naming(what: object) -> Iterator[None]:
    """Begin the message of an `OSError` or `InputError` with what it is about, such as a file.

    Raises
    ------
    InputError
        The block has raised one of them.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"{what}: {error.strerror or error}") from error
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def short_message(error: object) -> str:
    """Return another library's error as one short, printable line, to quote in a message.

    The library may quote any bytes of a damaged file.
    """
    line = printable(" ".join(str(error).split()))
    return line if len(line) <= _LONGEST_TEXT else f"{line[:_LONGEST_TEXT]} ..."


def located(error: BaseException) -> str:
    """Return an error of another package's code as one line, with the line of code that failed.

    An `MmtError` or `OSError` speaks of the outside, and is returned without it.
    """
    if isinstance(error, MmtError | OSError) and str(error):
        return str(error)
    place, file = "", None
    for frame, line in walk_tb(error.__traceback__):
        package = frame.f_globals.get("__name__", "").partition(".")[0]
        if file is None and not _PASSED.fullmatch(package):
            file = frame.f_code.co_filename
        if frame.f_code.co_filename == file:
            place = f" ({file}, line {line})"
    return f"{type(error).__name__}{': ' * bool(str(error))}{short_message(error)}{place}"


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
