"""Errors that speak to the person who runs the program."""


class MmtError(Exception):
    """A mistake or a fault that can be explained in a sentence.

    The command line prints the message alone, without a traceback, and exits with
    `exit_code`: 1 the run failed, 2 bad usage or input.
    """

    exit_code = 1


class InputError(MmtError):
    """What was given cannot be used: a file, a value, a combination of keys."""

    exit_code = 2
