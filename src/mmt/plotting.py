"""Plots of models, histories, evaluations and sessions, on given axes or on new ones.

=================== ==========================================================================
`TextureModel`      level over speed (along x, if by velocity) and force, and its samples
`ModelHistory`      completeness of the model after each update, and times of start and stop
`Evaluation`        power error at each step, beside the just noticeable difference
`RecordedSession`   acceleration without its mean, along the axis with most of its power
=================== ==========================================================================
"""

from functools import singledispatch
from typing import Any, Final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples
from mmt.core.output.palette import GRADED, LIGHT
from mmt.evaluation.reports.figures import draw_course, draw_power_error, lay_out_time
from mmt.evaluation.results import Evaluation
from mmt.session.data import FRAME_PERIOD_S, RecordedSession, sample_times
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.history import ModelHistory

_PLACES: Final = 60
_COLUMNS: Final = 1000


def plot(what: Any, ax: Axes | None) -> Axes:
    """Plot an object on the axes, or on new ones if None, and return the axes."""
    axes = plt.subplots(layout="constrained")[1] if ax is None else ax
    _draw(what, axes)
    return axes


@singledispatch
def _draw(what: object, _: Axes) -> None:
    raise InputError(f"nothing is plotted of a {type(what).__name__}")


@_draw.register
def _(model: TextureModel, axes: Axes) -> None:
    space, samples = model.space, model.samples
    speed_mm_s = np.linspace(0.0, space.maximum_speed_mm_s, _PLACES)
    force_n = np.linspace(0.0, space.maximum_force_n, _PLACES)
    speed, force = (each.ravel() for each in np.meshgrid(speed_mm_s, force_n))
    inputs = (speed, np.zeros_like(speed), force) if space.directed else (speed, force)
    level_db = model.level_db(*inputs)[0].reshape(_PLACES, _PLACES)
    drawn = axes.pcolormesh(speed_mm_s, force_n, level_db, shading="nearest", cmap=GRADED)
    axes.figure.colorbar(drawn, ax=axes, label="level (dB re 1 m/s²)")
    axes.scatter(
        samples.speed_mm_s, samples.force_n, s=9, c=LIGHT["panel"], ec=LIGHT["ink"], lw=0.5
    )
    axes.set_xlabel("speed (mm/s), level along x" if space.directed else "speed (mm/s)")
    axes.set_ylabel("normal force (N)")


@_draw.register
def _(history: ModelHistory, axes: Axes) -> None:
    course = np.array([(update.time_s, update.progress.value) for update in history.updates])
    draw_course(axes, {0: ("", course)}, history.updates[-1].progress.scale)
    lay_out_time(axes)
    for time_s, name in ((history.start_s, "start"), (history.stop_s, "stop")):
        if time_s is not None:
            axes.axvline(time_s, color=LIGHT["synthesized"], lw=1.0)
            axes.annotate(
                f"{name} at {time_s:.1f} s",
                (time_s, 0.02),
                xycoords=("data", "axes fraction"),
                rotation=90,
                fontsize=9,
            )


@_draw.register
def _(evaluation: Evaluation, axes: Axes) -> None:
    draw_power_error(axes, [evaluation])
    axes.legend(frameon=False, fontsize=9)
    lay_out_time(axes)


@_draw.register
def _(session: RecordedSession, axes: Axes) -> None:
    if "acceleration" not in session.channels or not len(session.frames):
        raise InputError("the session has no acceleration to plot")
    vibration = acceleration_samples(session.frames).astype(np.float64)
    vibration -= vibration.mean(axis=0)
    axis = int(np.argmax(np.square(vibration).mean(axis=0)))
    frame_s = 1e-9 * (session.frames["time_ns"] - session.frames["time_ns"][0])
    sample_s = sample_times(frame_s, len(vibration) // len(frame_s), FRAME_PERIOD_S)
    columns = min(_COLUMNS, len(vibration))
    rows = np.array_split(vibration[:, axis], columns)
    time_s = [part.mean() for part in np.array_split(sample_s, columns)]
    low, high = [row.min() for row in rows], [row.max() for row in rows]
    axes.fill_between(time_s, low, high, color=LIGHT["measured"], lw=0.5, ec=LIGHT["measured"])
    axes.set_ylabel(f"acceleration {'xyz'[axis]} without its mean (m/s²)")
    lay_out_time(axes)
