"""The strokes that a hand made in a session, at which its models are judged.

Where in its input space the hand was, which cells it left out, and what reaches the skin there.
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.evaluation.model_errors import Strokes, root_mean_square
from mmt.evaluation.results import AtSkin, Cell, Coverage
from mmt.texture.completion.distance import Cells, cell_distances, cells_of
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.space import InputSpace
from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse

if TYPE_CHECKING:
    from mmt.evaluation.truth import KnownTexture
    from mmt.session.stream import Recording
    from mmt.texture.model.texture_model import TextureModel

MOST: Final = 400
"""Largest number of strokes to compare a model at: one each 50 ms of a session of 20 s."""

_EVERY_S: Final = 0.01  # a stroke changes little within it
_PERCENTILES: Final = (5.0, 95.0)
_AT_REST_MM_S: Final = 1.0
_NAMED_CELLS: Final = 9
_EVENT: Final = "actuator response"
_LEAST_POWER: Final = 1e-12


class StrokesMade:
    """Speed, force and heading of a tool while it strokes the surface, block by block.

    Parameters
    ----------
    settings
        Settings of the modelling; slower or lighter motion is no stroking.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        self._settings = settings
        self._every = max(1, round(_EVERY_S * settings.rate_hz))
        self._seen = self._samples = 0
        self._parts: list[FloatArray] = []

    @classmethod
    def from_frames(cls, blocks: Iterable[RecordArray], settings: ModellingSettings) -> Self:
        """Return the strokes of frames, in blocks of shape (n,)."""
        made, stream = cls(settings), StreamFilter(settings)
        for block in blocks:
            made.add(stream.process(block))
        return made

    def add(self, motion: AlignedBlock) -> None:
        """Add the next block of filtered samples."""
        settings = self._settings
        stroking = motion.speed_mm_s >= settings.least_speed_mm_s
        stroking &= motion.normal_force_n >= settings.least_force_n
        chosen = np.flatnonzero(stroking)
        self._samples += len(chosen)
        chosen = chosen[(chosen + self._seen) % self._every == 0]
        self._seen += len(motion)
        heading = np.arctan2(motion.velocity_mm_s[chosen, 1], motion.velocity_mm_s[chosen, 0])
        rows = motion.speed_mm_s[chosen], motion.normal_force_n[chosen], heading
        self._parts.append(np.array(rows))

    @property
    def total_s(self) -> float:
        """Seconds of stroking so far."""
        return self._samples / self._settings.rate_hz

    def strokes(self, most: int = MOST) -> Strokes:
        """Return at most `most` strokes, evenly spread over the time of stroking."""
        rows = np.concatenate([np.empty((3, 0)), *self._parts], axis=1)
        count = min(most, rows.shape[1])
        chosen = ((np.arange(count) + 0.5) * rows.shape[1] / max(count, 1)).astype(np.int64)
        return Strokes(*rows[:, chosen])

    def ranges(self) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Return the usual range of the speed (mm/s) and of the force (N), None without strokes."""
        rows = np.concatenate([np.empty((3, 0)), *self._parts], axis=1)[:2]
        if not rows.size:
            return None, None
        speed, force = np.percentile(rows, _PERCENTILES, axis=1).T.tolist()
        return tuple(speed), tuple(force)


def coverage(
    strokes: StrokesMade,
    model: "TextureModel | None",
    settings: ModellingSettings,
    *,
    stopped: bool,
) -> Coverage:
    """Describe where the hand was and which cells are far from its samples.

    Parameters
    ----------
    strokes
        Strokes of the whole session.
    model
        The model at the end, None if there is none.
    settings
        Settings of the modelling.
    stopped
        Whether the stop criterion was met.
    """
    space = InputSpace(settings.inputs)
    points = np.empty((0, space.dimensions)) if model is None else model.points
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


def at_skin(
    session: "Recording",
    model: "TextureModel | None",
    truth: "KnownTexture | None",
    strokes: Strokes,
) -> AtSkin | None:
    """Return what reaches the skin, or None without a recorded response, a model or strokes.

    Parameters
    ----------
    session
        The recording; the last actuator response among its events is used.
    model
        The model that was rendered.
    truth
        The known texture; None to compare with the model itself.
    strokes
        The strokes made.

    Raises
    ------
    InputError
        The recorded response is not valid.
    """
    told = [event for event in session.events if event.get("event") == _EVENT]
    if not told or model is None or not len(strokes.force_n):
        return None
    try:
        response = ActuatorResponse.from_dict(told[-1])
    except InputError as error:
        raise InputError(f"session {session.path}: in its event {_EVENT!r} {error}") from error
    density = model.spectrum(*strokes.inputs(model.space).T, frequencies_hz=FREQUENCIES_HZ)
    wanted = density if truth is None else truth.spectrum(strokes, FREQUENCIES_HZ)
    played = (density * response.gain**2).sum(axis=1) + _LEAST_POWER
    error_db = 10.0 * np.log10(played / (wanted.sum(axis=1) + _LEAST_POWER))
    return AtSkin(
        played_share=float(np.mean(response.played_share(wanted))),
        low_hz=response.low_hz,
        power_error_db=root_mean_square(error_db),
    )
