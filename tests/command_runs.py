"""Commands of mmt, run in this process."""

import json

from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.core.errors import InputError


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)])


def output_of(*arguments):
    """Run a command that ends well; return what it prints."""
    result = run(*arguments)
    assert result.exit_code == 0, (result.output, result.exception)
    return result.output


def refusal(*arguments, kind=InputError):
    """Run a command that refuses what it is given; return what it says of it."""
    error = run(*arguments).exception
    assert isinstance(error, kind), error
    return str(error)


def run_json(folder, *arguments, code=0):
    """Run a command that ends with this code, or any if None; return its figures as well."""
    file = folder / "figures.json"
    result = run(*arguments, "--json", file)
    assert code is None or result.exit_code == code, (result.output, result.exception)
    return json.loads(file.read_text(encoding="utf-8")), result
