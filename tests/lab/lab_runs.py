"""Runs of an experiment as a command."""

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from mmt.cli.main import app


def run_lab(folder: Path, *arguments: str, code: int = 0) -> tuple[Any, str]:
    """Run ``mmt lab`` in this process; return its figures and what it printed."""
    file = folder / "figures.json"
    result = CliRunner().invoke(app, ["lab", *arguments, "--json", str(file)])
    assert result.exit_code == code, result.output
    return json.loads(file.read_text(encoding="utf-8")), result.output
