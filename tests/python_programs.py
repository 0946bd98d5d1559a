"""Programs of Python, each in a process and a session of its own."""

import subprocess
import sys


def printed_by(*program):
    """Return what a program prints: a file, or -c and its text, with its arguments."""
    command = [sys.executable, *map(str, program)]
    ended = subprocess.run(
        command, capture_output=True, text=True, start_new_session=True, timeout=150, check=False
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout
