"""``mmt lab``: experiments as commands, made from the parameters of their ``run``."""

import inspect
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mmt.cli.common import json_option, messages, output, print_error, report_option, write_json
from mmt.cli.options import simplify_help
from mmt.core.errors import InputError
from mmt.core.output.tables import plain_table
from mmt_lab.harness.experiment import listed, load
from mmt_lab.harness.findings import Findings

JsonFile = Annotated[Path | None, json_option("Write the figures.")]
"""File to which the figures are written."""

ReportFolder = Annotated[Path | None, report_option()]
"""The folder of the report."""


class Laboratory(TyperGroup):
    """A group whose commands are the experiments, each imported when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - as Typer calls it
        """Return the names of all experiments."""
        return [one.name for one in listed()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 - as Typer calls it
        """Return an experiment as a command; raise `InputError` if none has that name."""
        return command(cmd_name)

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 - as Typer calls it
        """Print the list of experiments, without importing any."""
        print_list()


def print_list() -> None:
    """Print every experiment with what it shows and how long it takes."""
    output.print("Usage: mmt lab EXPERIMENT [OPTIONS]   (--help after a name tells its options)\n")
    for group, title in (("lab", "Experiments"), ("bench", "Error against run time (mmt bench)")):
        table = plain_table(title, "experiment", "shows", "takes")
        rows = [(one.name, one.shows, one.takes) for one in listed() if one.group == group]
        for row in rows:
            table.add_row(*row)
        if rows:
            output.print(table)


def command(name: str) -> Any:
    """Return an experiment as a command of Typer."""
    app = typer.Typer(add_completion=False)
    summary = (inspect.getdoc(load(name)) or "").partition("\n\n")[0]
    app.command(name, help=summary)(_with_outputs(name))
    made = typer.main.get_command(app)
    made.name = name
    return simplify_help(made)


def _with_outputs(name: str) -> Callable[..., None]:
    """Return a function with the parameters of an experiment and those of the output files."""

    def call(json_file: Path | None, report: Path | None, **options: Any) -> None:
        if not report_findings(run(name, **options), json_file, report):
            raise typer.Exit(1)

    own = inspect.signature(load(name), eval_str=True)
    outputs = [
        inspect.Parameter("json_file", inspect.Parameter.KEYWORD_ONLY, annotation=JsonFile),
        inspect.Parameter("report", inspect.Parameter.KEYWORD_ONLY, annotation=ReportFolder),
    ]
    parameters = [*own.parameters.values(), *(each.replace(default=None) for each in outputs)]
    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {each.name: each.annotation for each in parameters}
    return call


def run(name: str, **options: Any) -> Findings:
    """Run an experiment; options that it does not have are ignored.

    Raises
    ------
    InputError
        An option or an input cannot be used.
    ImportError
        The experiment needs a package that is not installed.
    """
    for key, value in options.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"--{key.replace('_', '-')} {value}: must be a finite number")
    experiment = load(name)
    known = inspect.signature(experiment).parameters
    found = experiment(**{key: value for key, value in options.items() if key in known})
    return replace(found, name=name)


def report_findings(found: Findings, json_file: Path | None, report: Path | None) -> bool:
    """Print findings, write the files asked for, and return whether nothing failed."""
    from mmt_lab.harness.report import print_findings, print_targets, write_report

    print_findings(found)
    print_targets([found])
    write_json(json_file, found.as_dict())
    if report is not None:
        messages.print(f"report: {write_report(report, found)}")
    for failure in found.failures:
        print_error(failure)
    return not found.failures
