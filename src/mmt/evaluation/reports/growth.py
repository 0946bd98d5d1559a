"""The figure of a model as it grows, in the plane of speed and force or of velocity."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from mmt.core.arrays import FloatArray
from mmt.core.output.palette import GRADED, LIGHT
from mmt.evaluation.reports.figures import readiness
from mmt.evaluation.results import Evaluation
from mmt.texture.completion.distance import CELL_CENTRES, DIVISIONS, cell_distances, cells_of
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S


def model_growth(evaluation: Evaluation, panels: int = 4) -> Figure:
    """Draw the leader's model as it grows, as paper A's Fig. 3 does.

    Samples, triangulation, and the nine cells, each in the shade of its distance. A model of
    velocity is seen along the force: samples in the colour of their force, cells in the shade
    of their mean over forces.
    """
    along_force = evaluation.settings.inputs == "anisotropic"
    draw, centres, width, height, x, y = (
        (_draw_velocity, cells_of(3).centres, 1.8, 3.4, "velocity x (mm/s)", "velocity y (mm/s)")
        if along_force
        else (_draw_plane, CELL_CENTRES, 0.9, 3.2, "speed (mm/s)", "normal force (N)")
    )
    times_s = _growth_times(evaluation, panels)
    figure = Figure(figsize=(3.0 * len(times_s) + width, height), layout="constrained")
    axes = figure.subplots(1, len(times_s), sharey=True, squeeze=False)[0]
    limit = 2.0 * evaluation.settings.distances.stop / len(centres)
    for axis, time_s in zip(axes, times_s, strict=True):
        model = evaluation.model_at(time_s)
        cells, *forces = draw(axis, model, limit)
        count = 0 if model is None else len(model.samples)
        axis.set_title(f"{round(time_s, 1):g} s, {count} samples", fontsize=10)
        axis.set_xlabel(x)
    axes[0].set_ylabel(y)
    bar = figure.colorbar(cells, ax=axes, pad=0.01, extend="max")
    bar.set_label(f"distance to {4 if along_force else 3} nearest samples", fontsize=9)
    for drawn in forces:
        figure.colorbar(drawn, ax=axes, pad=0.01).set_label("normal force (N)", fontsize=9)
    return figure


def _draw_plane(axis: Axes, model: TextureModel | None, limit: float) -> list[Collection]:
    points = np.empty((0, 2)) if model is None else model.points
    size = np.array((MAXIMUM_SPEED_MM_S, MAXIMUM_FORCE_N)) / DIVISIONS
    corners = (CELL_CENTRES - 0.5 / DIVISIONS) * (MAXIMUM_SPEED_MM_S, MAXIMUM_FORCE_N)
    if model is not None:
        _draw_model(axis, model)
    axis.set(xlim=(0, MAXIMUM_SPEED_MM_S), ylim=(0, MAXIMUM_FORCE_N))
    return [_draw_cells(axis, corners, size, np.minimum(cell_distances(points), 3.0), limit)]


def _draw_velocity(axis: Axes, model: TextureModel | None, limit: float) -> list[Collection]:
    points = np.empty((0, 3)) if model is None else model.points
    size = np.full(2, 2.0 * MAXIMUM_SPEED_MM_S / DIVISIONS)
    corners = (2.0 * CELL_CENTRES - 1.0) * MAXIMUM_SPEED_MM_S - 0.5 * size
    mean = cell_distances(points).reshape(DIVISIONS, -1).mean(axis=0)
    cells = _draw_cells(axis, corners, size, np.minimum(mean, 2.0 * limit), limit)
    reach = Circle((0.0, 0.0), MAXIMUM_SPEED_MM_S)
    reach.set(fill=False, edgecolor=LIGHT["faint"], linewidth=0.8)
    axis.add_patch(reach)
    samples = np.empty((0, 3)) if model is None else model.samples.inputs
    forces = axis.scatter(
        samples[:, 0],
        samples[:, 1],
        s=19,
        c=samples[:, 2],
        cmap=GRADED,
        vmin=0.0,
        vmax=MAXIMUM_FORCE_N,
        edgecolors=LIGHT["ink"],
        lw=0.4,
        zorder=3,
    )
    limits = (-1.05 * MAXIMUM_SPEED_MM_S, 1.05 * MAXIMUM_SPEED_MM_S)
    axis.set(xlim=limits, ylim=limits, aspect="equal")
    return [cells, forces]


def _growth_times(evaluation: Evaluation, panels: int) -> list[float]:
    """Return times spread over the growth of the model, up to its final state."""
    final_s = evaluation.final.time_s
    updates = evaluation.models.updates
    times_s = [each.time_s for each in updates if each.time_s <= final_s and each.samples]
    if not times_s:
        return [final_s]
    chosen = np.unique(np.linspace(0, len(times_s) - 1, panels).round().astype(int))
    return [times_s[index] for index in chosen]


def _draw_cells(
    axis: Axes, corners: FloatArray, size: FloatArray, distances: FloatArray, limit: float
) -> Collection:
    cells = PatchCollection(
        [Rectangle((x, y), *size) for x, y in corners],
        cmap=readiness().reversed(),  # small distances are ready
        edgecolor=LIGHT["panel"],
        linewidth=1.5,
        zorder=0,
    )
    cells.set_array(distances)
    cells.set_clim(0.0, limit)
    axis.add_collection(cells)
    return cells


def _draw_model(axis: Axes, model: TextureModel) -> None:
    vertices = model.vertices[:, :2] * model.space.scale
    corners = model.triangulation.triangles[:, :3]
    axis.triplot(vertices[:, 0], vertices[:, 1], corners, color=LIGHT["faint"], lw=0.5, zorder=1)
    axis.scatter(
        vertices[:, 0],
        vertices[:, 1],
        s=10,
        c=LIGHT["panel"],
        edgecolors=LIGHT["faint"],
        lw=0.7,
        zorder=2,
        clip_on=False,
    )
    samples = model.points * model.space.scale
    axis.scatter(
        samples[:, 0],
        samples[:, 1],
        s=17,
        c=LIGHT["measured"],
        edgecolors=LIGHT["panel"],
        lw=0.5,
        zorder=3,
    )
