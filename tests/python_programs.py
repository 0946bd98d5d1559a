"""Programs of Python, each in a process of its own, to their end."""

import os
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


def run_mmt(folder, *arguments, **variables):
    """Run a program of mmt, such as "main" or "leader", in a folder, however it ends."""
    return subprocess.run(
        [sys.executable, "-m", "mmt.cli.entry", *map(str, arguments)],
        cwd=folder,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
