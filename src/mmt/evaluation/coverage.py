"""Where in its input space a hand has been, and which cells it left out."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.evaluation.results import Cell, Coverage
from mmt.evaluation.strokes_made import StrokesMade
from mmt.texture.completion.distance import Cells, cell_distances, cells_of
from mmt.texture.settings import ModellingSettings
from mmt.texture.space.inputs import InputSpace

_AT_REST_MM_S: Final = 1.0
_NAMED_CELLS: Final = 9


def coverage(
    strokes: StrokesMade,
    points: FloatArray,
    settings: ModellingSettings,
    *,
    stopped: bool,
) -> Coverage:
    """Describe where the hand was and which cells are far from its samples.

    Parameters
    ----------
    strokes
        Strokes of the whole session.
    points
        Normalised inputs of the model's samples, shape (k, d); none for k = 0.
    settings
        Settings of the modelling.
    stopped
        Whether the stop criterion was met.
    """
    space = InputSpace(settings.inputs)
    points = points if len(points) else np.empty((0, space.dimensions))
    cells = _cells(cells_of(space.dimensions), space, points, settings.distances.stop)
    ranges = strokes.ranges()
    return Coverage(
        cells=cells,
        stroking_s=strokes.total_s,
        speed_mm_s=ranges[0],
        force_n=ranges[1],
        remark=_remark(cells, ranges, settings, stopped=stopped),
    )


def _cells(
    of: Cells, space: InputSpace, points: FloatArray, stop_distance: float
) -> tuple[Cell, ...]:
    share = stop_distance / len(of.centres)
    centres = of.centres * space.scale
    cells = []
    for centre, distance in zip(centres, cell_distances(points), strict=True):
        speed_mm_s = float(space.speed_mm_s(centre[None])[0])
        turned = space.directed and speed_mm_s > _AT_REST_MM_S
        cells.append(
            Cell(
                speed_mm_s=speed_mm_s,
                force_n=float(centre[-1]),
                distance=float(distance),
                far=bool(distance > share),
                heading_deg=float(np.degrees(np.arctan2(centre[1], centre[0]))) if turned else None,
            )
        )
    return tuple(cells)


def _remark(
    cells: Sequence[Cell],
    ranges: tuple[tuple[float, float] | None, tuple[float, float] | None],
    settings: ModellingSettings,
    *,
    stopped: bool,
) -> str:
    speed, force = ranges
    if speed is None or force is None:
        return (
            f"The tool never stroked the surface: at no time were speed and force above "
            f"{settings.least_speed_mm_s:g} mm/s and {settings.least_force_n:g} N."
        )
    hand = (
        f"the tool stroked at {speed[0]:.0f} to {speed[1]:.0f} mm/s "
        f"with {force[0]:.2f} to {force[1]:.2f} N (5th to 95th percentile)"
    )
    if stopped:
        return f"The stop criterion was met; {hand}."
    far = sorted((cell for cell in cells if cell.far), key=lambda cell: -cell.distance)
    named = ", ".join(_place(cell) for cell in far[:_NAMED_CELLS])
    more = f" and {len(far) - _NAMED_CELLS} more" if len(far) > _NAMED_CELLS else ""
    lacking = f" Few samples lie near the cells centred at {named}{more}." if far else ""
    return f"The stop criterion was not met; {hand}.{lacking}"


def _place(cell: Cell) -> str:
    heading = "" if cell.heading_deg is None else f" at {cell.heading_deg:.0f}°"
    return f"({cell.speed_mm_s:.0f} mm/s{heading}, {cell.force_n:.1f} N)"
