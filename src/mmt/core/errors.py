"""Errors whose message is shown to the user."""

import re
from traceback import walk_tb
from typing import Final

FAILED: Final = "failed: "
"""Prefix of the outcome of a service that a fault has ended, and of the reason sent to its peer,
which then ends as failed too."""


_LONGEST_TEXT = 200
_PASSED: Final = re.compile(r"mmt(_bridges|_devices|_lab|_methods|_share)?|importlib|_frozen_.*")
"""Packages whose lines of code are not told."""


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


def short_message(error: object) -> str:
    """Return another library's error as one short, printable line, to quote in a message.

    The library may quote any bytes of a damaged file.
    """
    line = " ".join(str(error).split())
    plain = "".join(sign if sign.isprintable() else "?" for sign in line)
    return plain if len(plain) <= _LONGEST_TEXT else f"{plain[:_LONGEST_TEXT]} ..."


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
