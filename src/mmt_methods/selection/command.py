"""``mmt model select``: find needed and redundant samples and outliers of trials or models."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mmt.cli.common import Force, json_option, messages, output, write_json
from mmt.cli.models import SUFFIX
from mmt.core.errors import InputError
from mmt.core.files.existing import require_absent, write_file
from mmt.core.output.palette import LIGHT
from mmt.scene import Texture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mmt.core.arrays import FloatArray
    from mmt.texture.space import TextureSamples
    from mmt_methods.selection import Selection
    from mmt_methods.selection.pooling import Pool


class SelectionMethod(StrEnum):
    """How samples are selected."""

    OURS = "ours"
    PUBLISHED = "published"


def select_samples(
    sources: Annotated[
        list[Path], typer.Argument(metavar="MODEL|SESSION...", help="Models, or sessions.")
    ],
    *,
    target: Annotated[
        Path | None, typer.Option("--output", help="Write the selected model, a .npz file.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the plane, a .png file.")] = None,
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Sessions: take \\[texture] from this scene.")
    ] = None,
    tau: Annotated[
        float, typer.Option(min=0.0, help="Largest spectral error of the thinner model.")
    ] = 0.27,
    false_alarms: Annotated[
        float, typer.Option(min=0.001, max=0.2, help="Share of good samples taken for outliers.")
    ] = 0.01,
    largest: Annotated[
        int | None, typer.Option(min=1, help="Keep no more samples, but for the hull's corners.")
    ] = None,
    method: Annotated[
        SelectionMethod | None,
        typer.Option(help="Ours, or paper C's algorithm; else as the scene models."),
    ] = None,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    force: Force = False,
) -> None:
    """Select samples: which are kept, redundant or outliers, and how that changes the error."""
    for path, suffix in ((target, SUFFIX), (plot, ".png")):
        if path is not None and path.suffix.lower() != suffix:
            raise InputError(f"{path}: its name must end in {suffix}")
    if target is not None:
        require_absent(target, force=force)
    from mmt_methods.selection import SelectionSettings, select
    from mmt_methods.selection.pooling import left_out_errors
    from mmt_methods.selection.published import select_published

    pool = _pool(sources, scene_file)
    if (method or pool.settings.method) == "published":
        result = select_published(pool.data)
    else:
        result = select(pool.data, SelectionSettings(false_alarms, tau, largest))
    errors = left_out_errors(pool.data, result.outlier, result.kept)
    _print(pool, result, errors)
    write_json(json_file, _figures(pool, result, errors))
    if plot is not None:
        _draw(plot, pool, result)
    if target is not None:
        write_file(target, pool.model(result.kept).to_bytes())
        messages.print(f"model: {target}")


def _pool(sources: list[Path], scene_file: Path | None) -> "Pool":
    from mmt.cli.reporting import scene_of
    from mmt.session.files import read_session
    from mmt.session.stream import common_samples_per_frame
    from mmt.texture.model.texture_model import TextureModel
    from mmt_methods.selection.pooling import is_model, pool_models, pool_sessions

    kinds = {is_model(path) for path in sources}
    if len(kinds) > 1:
        raise InputError("models and sessions are named together: name one kind")
    if kinds == {True}:
        if scene_file is not None:
            raise InputError("--scene has the settings to model sessions, but models are given")
        models = [TextureModel.load(path) for path in sources]
        return pool_models(models, [str(path) for path in sources])
    sessions = [read_session(path) for path in sources]
    scene = scene_of(sessions[0], scene_file)
    texture = scene.texture or Texture()
    return pool_sessions(sessions, texture.settings(common_samples_per_frame(sessions)))


def _print(pool: "Pool", result: "Selection", errors: dict[str, Any]) -> None:
    channels = pool.samples.space.channels
    for index in result.outlier.nonzero()[0].tolist():
        place = ", ".join(
            f"{value:.4g} {_unit(name)}"
            for name, value in zip(channels, pool.samples.inputs[index], strict=True)
        )
        output.print(f"outlier at {place}: {result.reason[index]}; {pool.origin[index]}")
    output.print(
        f"{len(result.kept)} samples: {result.kept.sum()} kept, of these "
        f"{result.minimal.sum()} corners of the hull; {result.redundant.sum()} redundant; "
        f"{result.outlier.sum()} outlier{'' if result.outlier.sum() == 1 else 's'}"
    )
    if pool.data.segments is None:
        output.print("a model has no segments: fewer outliers can be found")
    for name in ("before", "after"):
        if name in errors:
            figures = errors[name]
            output.print(
                f"{name}: spectral error {figures['spectral_error']:.3f}, GFC "
                f"{figures['gfc']:.4f}, power {figures['power_error_db']:.2f} dB rms, at the "
                f"places of {errors['places']} good samples"
            )


def _unit(channel: str) -> str:
    return "N" if channel.endswith("_n") else "mm/s"


def _figures(pool: "Pool", result: "Selection", errors: dict[str, Any]) -> dict[str, Any]:
    rows = []
    for index, place in enumerate(pool.samples.inputs.tolist()):
        kind = "redundant"
        if result.outlier[index]:
            kind = "outlier"
        elif result.kept[index]:
            kind = "kept"
        rows.append(
            {
                **dict(zip(pool.samples.space.channels, place, strict=True)),
                "kind": kind,
                "minimal": bool(result.minimal[index]),
                "score": float(result.score[index]),
                "reason": result.reason[index],
                "source": pool.origin[index],
            }
        )
    return {
        "count": len(rows),
        "kept": int(result.kept.sum()),
        "redundant": int(result.redundant.sum()),
        "outliers": int(result.outlier.sum()),
        "compression": result.compression,
        "limit": result.limit,
        "errors": errors,
        "samples": rows,
    }


def _draw(path: Path, pool: "Pool", result: "Selection") -> None:
    from mmt.evaluation.reports.figures import to_png

    write_file(path, to_png(selection_plane(pool.samples, result)))
    messages.print(f"plot: {path}")


def selection_plane(samples: "TextureSamples", selection: "Selection") -> "Figure":
    """Draw kept and redundant samples and outliers, with a second panel if the heading counts."""
    import numpy as np
    from matplotlib.figure import Figure

    directed = samples.space.directed
    figure = Figure(figsize=(9.6 if directed else 5.4, 4.0), layout="constrained")
    axes = figure.subplots(1, 2 if directed else 1, squeeze=False)[0]
    _scatter(axes[0], np.column_stack([samples.speed_mm_s, samples.force_n]), selection)
    axes[0].set(xlabel="speed (mm/s)", ylabel="normal force (N)")
    if directed:
        _scatter(axes[1], samples.inputs[:, :2], selection)
        axes[1].set(xlabel="velocity x (mm/s)", ylabel="velocity y (mm/s)", aspect="equal")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure


def _scatter(axis: "Axes", places: "FloatArray", selection: "Selection") -> None:
    for name, chosen, size, colour, marker in (
        ("redundant", selection.redundant, 12.0, LIGHT["known"], "o"),
        ("kept", selection.kept, 26.0, LIGHT["streamed"], "o"),
        ("outlier", selection.outlier, 34.0, LIGHT["synthesized"], "X"),
    ):
        axis.scatter(
            places[chosen, 0],
            places[chosen, 1],
            s=size,
            color=colour,
            marker=marker,
            label=f"{name} ({int(chosen.sum())})",
        )
