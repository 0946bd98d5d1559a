"""Runs of an experiment as a command."""

from pathlib import Path
from typing import Any

from command_runs import run_json


def run_lab(folder: Path, *arguments: str, code: int = 0) -> tuple[Any, str]:
    """Run ``mmt lab`` in this process; return its figures and what it printed."""
    figures, result = run_json(folder, "lab", *arguments, code=code)
    return figures, result.output
