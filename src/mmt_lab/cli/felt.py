"""``mmt evaluate --end-to-end``: what the operator feels, over each network."""

from pathlib import Path

from mmt.cli.common import messages, output, write_json
from mmt.core.errors import InputError
from mmt.evaluation.table import as_rich
from mmt_lab.cli.counting import check_workers, counting, names_of, processes
from mmt_lab.felt.presenting import felt_table, write_felt_report
from mmt_lab.felt.summary import as_dict, cases, feel_all
from mmt_lab.methods.cases import known_textures


def print_felt(
    sessions: list[Path],
    *,
    seeds: int,
    textures: str | None,
    workers: int | None,
    json_file: Path | None,
    report: Path | None,
) -> None:
    """Run the sessions, print the table, and write what is asked for.

    Raises
    ------
    InputError
        A session is given, a texture is not known, or a file cannot be written.
    """
    if sessions:
        raise InputError(f"--end-to-end makes its own sessions, it cannot use {sessions[0]}")
    check_workers(workers)
    chosen = cases(seeds, known_textures(names_of(textures)))
    with counting("stroking", len(chosen)) as done:
        outcomes = feel_all(chosen, processes(workers, len(chosen)), done)
    output.print(as_rich(felt_table(outcomes)))
    write_json(json_file, as_dict(outcomes))
    if report is not None:
        messages.print(f"report: {write_felt_report(report, outcomes)}", highlight=False)
