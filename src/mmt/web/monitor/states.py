"""Messages that change seldom: the session, the model, completion, the link, the ticks."""

import itertools
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy.typing as npt

from mmt.core.extras import __version__
from mmt.scene import Scene, Texture
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S
from mmt.web.page_server import pack

if TYPE_CHECKING:
    from mmt.core.running.ticking import Ticker, TimeHistogram
    from mmt.link.server import LeaderServer
    from mmt.texture.completion.criterion import Progress
    from mmt.texture.model.texture_model import TextureModel

LATENCY_MS: Final = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Bin edges of the histogram of latencies."""
_PERIOD_MS: Final = (0.5, 0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.3, 1.5, 2, 5, 10)
_COUNTS: Final = ("frames", "lost", "out_of_order", "repeated", "dropped", "commands")


def hello_header(scene: Scene, session_id: str) -> dict[str, Any]:
    """Return names, limits and thresholds of a session; ``rate_hz`` is the vibration's."""
    return {
        "session": scene.session.name,
        "id": session_id,
        "version": __version__,
        "parts": [name for name, runs in scene.parts().items() if runs],
        "rate_hz": scene.session.acceleration_rate_hz,
        "inputs": (scene.texture or Texture()).inputs,
        "maximum_speed_mm_s": MAXIMUM_SPEED_MM_S,
        "maximum_force_n": MAXIMUM_FORCE_N,
        "criterion": asdict((scene.texture or Texture()).settings().scale),
    }


def surfaces(found: tuple[int, list[int]] | None) -> dict[str, dict[str, int]]:
    """Return the surface under the tool and the number of known ones; {} if there is only one."""
    if found is None:
        return {}
    now, known = found
    return {"surfaces": {"now": now, "known": len(known)}}


def completion_header(
    progress: "Progress | None", start_s: float | None, stop_s: float | None, faults: str = ""
) -> dict[str, Any]:
    """Return the criterion's value for a model, and the session times at which it was met.

    ``cells`` are values for the cells of the input space, ``advice`` the inputs of the most useful
    stroke; both are None without a model. ``faults`` describes invalid samples, "" if none.
    """
    return {
        "value": None if progress is None else progress.value,
        "cells": None if progress is None else [round(value, 4) for value in progress.cells],
        "advice": None if progress is None or stop_s is not None else progress.advice,
        "start_s": start_s,
        "stop_s": stop_s,
        "faults": faults,
    }


def model_message(model: "TextureModel | None") -> bytes:
    """Return samples, triangulation and cells of a model, or an empty message for None.

    Points and vertices are normalised: speed and force, or velocity x, y and force. There are
    9 cells over speed and force, or 27 over velocity and force.
    """
    if model is None:
        return pack("model", {"samples": 0, "order": None, "cells": None}, {})
    from mmt.texture.completion.distance import cell_distances

    points, dimensions = model.points, model.space.dimensions
    header: dict[str, Any] = {"samples": len(points), "order": model.order}
    header["cells"] = [round(value, 4) for value in cell_distances(points).tolist()]
    arrays: dict[str, npt.ArrayLike] = {"points": points}
    if not model.interpolant.is_network:  # then the model has a triangulation already
        arrays["vertices"] = model.vertices[:, :dimensions]
        links = model.triangulation.triangles[:, : dimensions + 1]
        arrays["tetrahedra" if model.space.directed else "triangles"] = links
    return pack("model", header, arrays)


def link_message(server: "LeaderServer") -> bytes:
    """Return counts and latencies of the link; takes about 0.5 ms."""
    statistics = asdict(server.statistics)
    header = {name: statistics[name] for name in _COUNTS}
    header |= {
        "rejected": sum(statistics["rejected"].values()),
        "connected": server.connected,
        "latency_p50_ms": statistics["latency_p50_ms"],
        "latency_p99_ms": statistics["latency_p99_ms"],
        "clock": statistics["clock"],
    }
    return pack("link", header | _histogram(server.endpoint.reader.latency, LATENCY_MS), {})


def ticks_message(ticker: "Ticker | None", playout_delay_ms: float | None) -> bytes:
    """Return statistics of the leader's ticks; takes about 0.3 ms."""
    if ticker is None:
        return pack("ticks", {}, {})
    header = asdict(ticker.statistics)
    if playout_delay_ms is not None:
        header["playout_delay_ms"] = playout_delay_ms
    return pack("ticks", header | _histogram(ticker.periods, _PERIOD_MS), {})


def _histogram(histogram: "TimeHistogram", bounds_ms: tuple[float, ...]) -> dict[str, Any]:
    """Return bin edges, and counts below the first, between each two, and above the last."""
    below, _ = histogram.cumulative([round(bound * 1e6) for bound in bounds_ms])
    edges = [0, *below, histogram.count]
    counts = [after - before for before, after in itertools.pairwise(edges)]
    return {"bounds_ms": list(bounds_ms), "counts": counts}


def thinned(points: list[tuple[float, float]], most: int) -> list[tuple[float, float]]:
    """Return every k-th point and the last one, with k such that about `most` remain."""
    step = math.ceil(len(points) / most)
    return points if step <= 1 else [*points[::step], points[-1]]
