"""``mmt evaluate --compare``: methods of texture modelling side by side."""

from pathlib import Path

from mmt.cli.common import messages, output, write_json
from mmt.evaluation.table import as_rich
from mmt_lab.cli.counting import check_workers, counting, names_of, processes
from mmt_lab.methods.cases import recorded_cases, simulated_cases
from mmt_lab.methods.judging import check_methods
from mmt_lab.methods.running import run_cases
from mmt_lab.methods.summary import MethodComparison
from mmt_lab.methods.tables import method_tables, verdicts, write_method_report


def print_methods(
    compared: str,
    strokes: list[Path],
    *,
    seeds: int,
    textures: str | None,
    workers: int | None,
    json_file: Path | None,
    report: Path | None,
) -> None:
    """Judge the methods, print the tables, and write what is asked for.

    Raises
    ------
    InputError
        A method or texture is not known, or a file cannot be written.
    """
    methods = names_of(compared) or []
    check_methods(methods)
    check_workers(workers)
    chosen = names_of(textures)
    cases = simulated_cases(seeds, chosen)
    recorded, remarks = recorded_cases(strokes, chosen)
    for remark in remarks:
        messages.print(remark, highlight=False)
    cases += recorded
    with counting("comparing", len(cases)) as done:
        judged, sure = run_cases(cases, methods, processes(workers, len(cases)), done)
    comparison = MethodComparison(tuple(methods), tuple(judged), tuple(remarks), tuple(sure))
    for table in method_tables(comparison):
        output.print(as_rich(table))
    for sentence in verdicts(comparison):
        output.print(sentence, highlight=False)
    write_json(json_file, comparison.as_dict())
    if report is not None:
        messages.print(f"report: {write_method_report(report, comparison)}", highlight=False)
