"""``mmt evaluate``: recorded sessions, or one of the comparisons that make their own."""

from pathlib import Path
from typing import Annotated

import typer

from mmt.core.errors import InputError


def evaluate(
    sessions: Annotated[list[Path] | None, typer.Argument(metavar="SESSION...")] = None,
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    step: Annotated[float, typer.Option(help="Seconds between the rows.")] = 2.5,
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Chooses the segments that are held out; of --surfaces the first seed."
        ),
    ] = 0,
    feedback: Annotated[
        bool, typer.Option("--feedback", help="Force feedback over a delay, by method.")
    ] = False,
    selection: Annotated[
        bool, typer.Option("--selection", help="Sample selection, published against ours.")
    ] = False,
    surfaces: Annotated[
        bool, typer.Option("--surfaces", help="Sessions over several known surfaces.")
    ] = False,
    compare: Annotated[
        str | None,
        typer.Option("--compare", metavar="METHOD,METHOD", help="Methods of modelling."),
    ] = None,
    end_to_end: Annotated[
        bool, typer.Option("--end-to-end", help="What the hand feels over a network, by method.")
    ] = False,
    textures: Annotated[
        str | None,
        typer.Option(help="Of --compare and --end-to-end: some of the known textures."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Of --compare and --end-to-end: processes.")
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1, help="Of --selection (20), --compare (10), --surfaces (2), --end-to-end (3)."
        ),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there.")] = None,
) -> None:
    """Evaluate recorded sessions: distance and fit against session time."""
    given = sessions or []
    asked = {
        "--feedback": feedback,
        "--selection": selection,
        "--surfaces": surfaces,
        "--compare": compare is not None,
        "--end-to-end": end_to_end,
    }
    chosen = [name for name, wanted in asked.items() if wanted]
    if len(chosen) > 1:
        raise InputError(f"evaluate: {' and '.join(chosen)} exclude each other, give one of them")
    if not given and not chosen:
        names = ", ".join(asked)
        raise InputError(f"evaluate: name a session, or give one of {names}")
    if feedback:
        from mmt_lab.cli.feedback import print_feedback

        print_feedback(given, seed=seed, json_file=json_file, report=report)
    elif selection:
        from mmt_lab.cli.selection_table import print_selection

        print_selection(given, seeds=seeds or 20, json_file=json_file, report=report)
    elif surfaces:
        from mmt_lab.cli.surfaces_table import print_surfaces

        print_surfaces(given, seeds=seeds or 2, seed=seed, json_file=json_file, report=report)
    elif compare is not None:
        from mmt_lab.cli.method_tables import print_methods

        print_methods(
            compare,
            given,
            seeds=seeds or 10,
            textures=textures,
            workers=workers,
            json_file=json_file,
            report=report,
        )
    elif end_to_end:
        from mmt_lab.cli.felt import print_felt

        print_felt(
            given,
            seeds=seeds or 3,
            textures=textures,
            workers=workers,
            json_file=json_file,
            report=report,
        )
    else:
        from mmt.cli.evaluating import evaluate_files

        evaluate_files(
            given, scene_file=scene_file, step_s=step, seed=seed, json_file=json_file, report=report
        )
