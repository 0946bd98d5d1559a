"""The report of a run or of an evaluation: Markdown, HTML, figures and JSON in one folder."""

import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import mmt
from mmt.errors import InputError
from mmt.evaluation import tables
from mmt.evaluation.document import (
    Block,
    Heading,
    Listing,
    Paragraph,
    Picture,
    Table,
    to_html,
    to_markdown,
)
from mmt.evaluation.results import DEFINITIONS, Evaluation, evaluations_as_dict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: Final = "figures"
"""The folder of the PNG files beside the report."""

_PACKAGES: Final = ("numpy", "scipy", "numba", "matplotlib")


def write_report(
    directory: Path,
    evaluations: Sequence[Evaluation],
    *,
    title: str = "Evaluation",
    scene: Mapping[str, Any] | None = None,
    run: Mapping[str, object] | None = None,
) -> Path:
    """Write ``report.md``, ``report.html``, ``summary.json`` and the figures.

    Parameters
    ----------
    directory
        Made where it does not exist; files of an earlier report are replaced.
    evaluations
        May be empty where only a run is reported.
    title
        Of the report.
    scene
        The resolved scene as tables.
    run
        What the services said of themselves, as nested tables: one section for each key.

    Returns
    -------
    Path
        Of ``report.html``, which holds its figures inside.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    pictures = _Pictures(directory / FIGURES)
    blocks: list[Block] = [Heading(title, 1)]
    try:
        (directory / FIGURES).mkdir(parents=True, exist_ok=True)
        if evaluations:
            blocks += _overview(evaluations, pictures)
        if run:
            blocks += tables.run_blocks(run)
        for place, evaluation in enumerate(evaluations):
            blocks += _session(evaluation, f"{place + 1}-{_file_name(evaluation.name)}", pictures)
        blocks += _appendix(scene, with_scores=bool(evaluations))
        page = directory / "report.html"
        page.write_text(to_html(title, blocks), encoding="utf-8")
        (directory / "report.md").write_text(to_markdown(blocks), encoding="utf-8")
        summary = {**evaluations_as_dict(evaluations), "environment": environment()}
        summary |= {"scene": scene} if scene is not None else {}
        summary |= {"run": run} if run is not None else {}
        text = json.dumps(summary, indent=2, default=str) + "\n"
        (directory / "summary.json").write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"report {directory}: {error.strerror or error}") from error
    return page


def environment() -> dict[str, str]:
    """Return the versions and the machine that figures were computed with."""
    versions = {"mmt": mmt.__version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    machine = f"{platform.system()} {platform.release()}, {platform.machine()}"
    return {**versions, "machine": machine, "processors": str(os.cpu_count() or "unknown")}


class _Pictures:
    """Draw figures, keep each as a file, and return it as a block."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def draw(self, name: str, caption: str, make: "Callable[[], Figure]") -> Picture:
        from mmt.evaluation.figures import to_png

        png = to_png(make())
        (self._directory / f"{name}.png").write_bytes(png)
        return Picture(f"{FIGURES}/{name}.png", png, caption)


def _overview(evaluations: Sequence[Evaluation], pictures: _Pictures) -> list[Block]:
    from mmt.evaluation import figures

    blocks: list[Block] = [
        Heading("Overview"),
        tables.overview(evaluations),
        tables.by_time(evaluations, "distance", 2, "Distance sum at each step (paper A, Table I)"),
        pictures.draw(
            "distance",
            "Completion: the distance sum after each update, and both thresholds.",
            lambda: figures.distance_over_time(evaluations),
        ),
    ]
    if any(step.gfc is not None for e in evaluations for step in e.steps):
        blocks += [
            tables.by_time(evaluations, "gfc", 3, "GFC of the held-out segments at each step"),
            pictures.draw(
                "gfc",
                "GFC of the held-out segments; dotted: what the model scores against itself; "
                "dashed: 0.9.",
                lambda: figures.gfc_over_time(evaluations),
            ),
        ]
    if any(step.power_error_db is not None for e in evaluations for step in e.steps):
        blocks.append(
            pictures.draw(
                "power_error",
                "Power error, which GFC ignores; dashed: the just noticeable difference.",
                lambda: figures.power_error_over_time(evaluations),
            )
        )
    return blocks


def _session(evaluation: Evaluation, prefix: str, pictures: _Pictures) -> list[Block]:
    from mmt.evaluation import figures

    blocks: list[Block] = [
        Heading(f"Session {evaluation.name}"),
        Paragraph(tables.account(evaluation)),
        Paragraph(evaluation.coverage.remark),
        tables.moments(evaluation),
        pictures.draw(
            f"{prefix}-model",
            "The model as it grows: samples (red), boundary points (white), triangulation, and "
            "the nine cells in the shade of their distance to the three nearest samples.",
            lambda: figures.model_growth(evaluation),
        ),
    ]
    if evaluation.held_out:
        blocks += [
            pictures.draw(
                f"{prefix}-spectra",
                "Held-out segments: measured, and synthesized by the model rebuilt without "
                f"them, at {evaluation.final.time_s:.1f} s.",
                lambda: figures.held_out_spectra(evaluation),
            ),
            tables.held_out(evaluation),
        ]
    if evaluation.power_map is not None:
        blocks += [
            pictures.draw(
                f"{prefix}-errors",
                f"The model at {evaluation.final.time_s:.1f} s against the known texture; dots: "
                "samples; circles: the worst points.",
                lambda: figures.power_error_map(evaluation),
            ),
            tables.worst(evaluation),
        ]
    return [*blocks, Heading("Every step", 3), tables.steps(evaluation)]


def _appendix(scene: Mapping[str, Any] | None, *, with_scores: bool) -> list[Block]:
    blocks: list[Block] = []
    if with_scores:
        rows = [(name, text) for name, text in DEFINITIONS.items()]
        blocks += [Heading("How the scores are defined"), Table(("score", "definition"), rows)]
    blocks += [
        Heading("Made with"),
        Table(("part", "version"), list(environment().items())),
    ]
    if scene is not None:
        blocks.append(Listing("The resolved scene", json.dumps(scene, indent=2, default=str)))
    return blocks


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)[:48]
