"""The two pictures of a stability report."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from mmt.core.output.palette import GRADED, LIGHT, SERIES
from mmt_lab.stability.loop_theory import critical_delay_s

_LEAST_GROWTH: Final = 1e-6
_MOST_GROWTH: Final = 1e3
_MOST_DELAY_MS: Final = 220.0
_TICKS_MS: Final = (0, 1, 2, 5, 10, 20, 50, 100, 200)


def contact_map(figures: Mapping[str, Any]) -> Figure:
    """Draw by how much impacts grow, over step and stiffness, for each integrator."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    step_ms, stiffness = 1e3 * np.array(figures["step_s"]), np.array(figures["stiffness_n_m"])
    image = None
    for axis, (name, growth) in zip(axes, figures["growth"].items(), strict=True):
        grown = np.ma.masked_less(np.array(growth), _LEAST_GROWTH)
        axis.set_facecolor(LIGHT["unready"])
        image = axis.pcolormesh(
            step_ms,
            stiffness,
            grown,
            norm=LogNorm(_LEAST_GROWTH, _MOST_GROWTH),
            cmap=GRADED,
            shading="nearest",
        )
        if name in figures["limit_s"]:
            limit_ms = 1e3 * np.array(figures["limit_s"][name])
            axis.plot(
                limit_ms, stiffness, color=LIGHT["ink"], lw=1.4, ls="--", label="theoretical limit"
            )
            axis.legend(loc="lower left", fontsize=8, framealpha=0.9)
        elif grown.count() == 0:
            axis.text(
                0.5, 0.5, "no growth", transform=axis.transAxes, ha="center", color=LIGHT["faint"]
            )
        axis.set(
            xscale="log",
            yscale="log",
            xlim=(step_ms[0], step_ms[-1]),
            ylim=(stiffness[0], stiffness[-1]),
        )
        axis.set_title(name, fontsize=10)
        axis.set_xlabel("step (ms)")
    axes[0].set_ylabel("stiffness (N/m)")
    if image is not None:
        bar = figure.colorbar(image, ax=axes, extend="both", pad=0.02)
        bar.set_label("growth of energy in an impact,\nas a share of it")
    return figure


def loop_map(figures: Mapping[str, Any], boundaries: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw which delays are stable on which walls, measured and by theory.

    Parameters
    ----------
    figures
        Figures of the map.
    boundaries
        Boundary of each wall: ``wall_n_mm``, and ``measured_ms``, the round trip from which the
        motion grows.
    """
    figure = Figure(figsize=(8.4, 4.9), layout="constrained")
    axis = figure.subplots()
    _draw_theory(axis)
    walls, delays = np.meshgrid(figures["wall_n_mm"], figures["delay_ms"])
    grows = np.array(figures["grows"], dtype=bool)
    axis.plot(walls[~grows], delays[~grows], "o", ms=5, color=SERIES[0], label="dies out")
    axis.plot(walls[grows], delays[grows], "x", ms=6, color=SERIES[1], label="grows")
    measured = [row for row in boundaries if np.isfinite(row["measured_ms"])]
    axis.plot(
        [row["wall_n_mm"] for row in measured],
        [0.5 * row["measured_ms"] for row in measured],
        "D",
        ms=6,
        mfc="none",
        mec=LIGHT["ink"],
        label="measured boundary",
    )
    axis.set_xscale("log")
    axis.set_yscale("symlog", linthresh=1.0)
    axis.set(xlim=(0.085, 60.0), ylim=(-0.15, _MOST_DELAY_MS))
    axis.set_yticks(_TICKS_MS, labels=[str(tick) for tick in _TICKS_MS])
    axis.set_xticks([0.1, 1.0, 10.0], labels=["0.1", "1", "10"])
    axis.set_xlabel("stiffness of the wall (N/mm)")
    axis.set_ylabel("delay one way (ms)")
    figure.legend(loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def _draw_theory(axis: Axes) -> None:
    walls = np.geomspace(0.08, 65.0, 300)
    critical_ms = np.array([500.0 * critical_delay_s(wall) for wall in walls.tolist()])
    line = np.clip(critical_ms, 0.0, 10.0 * _MOST_DELAY_MS)
    axis.fill_between(walls, line, 1e4, color=SERIES[1], alpha=0.13, lw=0)
    axis.fill_between(walls, -1.0, line, color=SERIES[0], alpha=0.10, lw=0)
    axis.plot(walls, line, color=LIGHT["ink"], lw=1.3, label="theory")
