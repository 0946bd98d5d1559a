"""``mmt bench``: run stages, print their findings, and write one report of all."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from mmt.cli.common import messages
from mmt.core.errors import InputError, MmtError
from mmt.core.extras import install_command
from mmt.evaluation.reports.document import Block, Heading, Paragraph, ReportTable
from mmt.evaluation.reports.report import machine_table
from mmt.evaluation.reports.report_files import write_report_files
from mmt_lab.harness import command
from mmt_lab.harness.experiment import listed
from mmt_lab.harness.findings import Findings, SkippedMethod
from mmt_lab.harness.report import found_blocks, print_findings, print_targets, target_blocks

TITLE: Final = "Error against run time"


def run_benches(
    names: Sequence[str], report: Path | None = None, **options: Any
) -> tuple[list[Findings], dict[str, Any]]:
    """Run the named stages, or all if none is named; print the findings of each when it ends.

    Returns
    -------
    results, figures
        Findings of the stages that did not fail, and the content for ``--json``. If stages
        failed, the key ``failed`` of the content holds the reason for each.
    """
    stages = [each.name for each in listed("bench")]
    unknown = [name for name in names if name not in stages]
    if unknown:
        raise InputError(f"bench {unknown[0]}: allowed are {', '.join(stages)}")
    results, failed = [], {}
    for name in dict.fromkeys(names or stages):
        messages.print(f"measuring: {name}")
        try:
            results.append(run_stage(name, **options))
        except MmtError as error:  # keep the other stages' findings, which may take an hour
            failed[name] = str(error)
            messages.print(f"{name}: {error}")
        else:
            print_findings(results[-1])
    print_targets(results)
    about = machine_table()
    if report is not None:
        page = write_bench_report(report, results, about)
        messages.print(f"report: {page}")
    return results, as_dict(results, about) | ({"failed": failed} if failed else {})


def run_stage(name: str, **options: Any) -> Findings:
    """Run a stage; if a package that it needs is not installed, return findings that say so."""
    try:
        return command.run(name, **options)
    except ImportError as error:
        missing = error.name or str(error)
        remedy = install_command("bench")
        left_out = SkippedMethod(missing, "the stage needs it for its reference", remedy)
        return Findings(name, "Not measured.", left_out=(left_out,), name=name)


def as_dict(results: Sequence[Findings], machine: Mapping[str, str]) -> dict[str, Any]:
    """Return a run as a dictionary for JSON: the machine, and every stage by its name."""
    return {"machine": dict(machine), **{result.name: result.as_dict() for result in results}}


def write_bench_report(
    directory: Path, results: Sequence[Findings], machine: Mapping[str, str]
) -> Path:
    """Write ``report.md``, ``report.html``, ``figures/`` and ``bench.json``; return the page."""
    blocks: list[Block] = [
        Heading(TITLE, 1),
        Paragraph(
            "Methods took turns on the machine below; times are medians over rounds, with half "
            "the distance of the quartiles behind them. Trust the ratios within this run more "
            "than the times."
        ),
        ReportTable(("what", "value"), list(machine.items()), "Machine"),
        *target_blocks(results),
    ]
    for result in results:
        blocks += [Heading(result.title), *found_blocks(replace(result, targets=()))]
    return write_report_files(directory, TITLE, blocks, "bench.json", as_dict(results, machine))
