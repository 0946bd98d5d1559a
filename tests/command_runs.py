"""Commands of mmt, run in this process."""

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from mmt.cli.main import app
from mmt.core.errors import InputError, MmtError


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


def output_of(*arguments: object) -> str:
    """Run a command that ends well; return what it prints."""
    result = run(*arguments)
    assert result.exit_code == 0, (result.output, result.exception)
    return result.output


def refusal(*arguments: object, kind: type[MmtError] = InputError) -> str:
    """Run a command that refuses what it is given; return what it says of it."""
    error = run(*arguments).exception
    assert isinstance(error, kind), error
    return str(error)


def run_json(folder: Path, *arguments: object, code: int | None = 0) -> tuple[Any, Result]:
    """Run a command that ends with this code, or any if None; return its figures as well."""
    file = folder / "figures.json"
    result = run(*arguments, "--json", file)
    assert code is None or result.exit_code == code, (result.output, result.exception)
    return json.loads(file.read_text(encoding="utf-8")), result
