"""The commands that the laboratory adds to ``mmt``: lab, bench, stability.

``mmt`` finds them by the entry points ``mmt.commands``. Help imports this module, but no
experiment: an experiment is imported when it runs.
"""

from typing import Annotated

import typer

from mmt.cli.common import messages, write_json
from mmt.core.errors import MmtError
from mmt_lab.harness.command import (
    JsonFile,
    Laboratory,
    ReportFolder,
    print_list,
    report_findings,
    run,
)
from mmt_lab.harness.experiment import AccelerationRate, Duration, Loss, RealTime, Strangers, listed
from mmt_lab.stability.families import Families

lab = typer.Typer(
    cls=Laboratory, add_completion=False, help="Run an experiment; without a name, list them."
)
bench = typer.Typer(add_completion=False)
stability = typer.Typer(add_completion=False)


@lab.callback(invoke_without_command=True)
def _lab(context: typer.Context) -> None:
    """Run an experiment; without a name, list them."""
    if context.invoked_subcommand is None:
        print_list()


@bench.command("bench")
def _bench(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="STAGE",
            help=f"{', '.join(each.name for each in listed('bench'))}; all if none is named.",
        ),
    ] = None,
    duration: Duration = 20.0,
    json_file: JsonFile = None,
    report: ReportFolder = None,
    realtime: RealTime = False,
    strangers: Strangers = False,
    loss: Loss = False,
    acceleration_rate: AccelerationRate = 1000,
) -> None:
    """Measure error against run time on this machine, for mmt and every peer installed."""
    from mmt_lab.bench.command import run_benches

    options = {"duration": duration, "realtime": realtime, "strangers": strangers, "loss": loss}
    options["acceleration_rate"] = acceleration_rate
    _, figures = run_benches(what or [], report, **options)
    write_json(json_file, figures)
    messages.print("ratios within one run are to be trusted, absolute times are not")
    if "failed" in figures:
        raise MmtError(f"not measured: {', '.join(figures['failed'])}")


@stability.command("stability")
def _stability(
    families: Families = None,
    json_file: JsonFile = None,
    report: ReportFolder = None,
) -> None:
    """Run the stiff and extreme cases, a row each, and say whether each held."""
    found = run("stability", families=families)
    if not report_findings(found, json_file, report):
        raise typer.Exit(1)
