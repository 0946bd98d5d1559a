"""Errors whose message is shown to the user."""

from typing import Final

FAILED: Final = "failed: "
"""Begins the outcome of a service that a fault has ended, and the reason that it gives its
peer, which then ends as failed as well."""


class MmtError(Exception):
    """An error that can be explained to the user in a sentence.

    The command line prints the message alone, without a traceback, and exits with
    `exit_code`: 1 the run failed, 2 bad usage or input.
    """

    exit_code = 1


class InputError(MmtError):
    """Input that cannot be used: a file, a value, a combination of keys."""

    exit_code = 2


class DeviceLost(MmtError):  # noqa: N818 - it is what has happened to the device
    """A device that worked before no longer answers; it may be connected again later."""
