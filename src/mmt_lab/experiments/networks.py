"""Networks against triangles: error, and the time to build, to add a sample, and to ask."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.testing.simulation.textures import get_surface
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt.texture.model.samples import TextureSamples
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S
from mmt_lab.bench.measuring import interleave, spread
from mmt_lab.bench.network_methods import DELAUNAY, METHODS, OURS, Filters, part_of
from mmt_lab.bench.textures import Known, exact_samples
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import (
    MICROSECONDS,
    Axis,
    Cell,
    Curves,
    Findings,
    Panel,
    Records,
    Spread,
    Target,
)

SAMPLES: Final = Axis("samples", "samples")
BUILDING: Final = Axis("time to build (ms)", "build, ms")
ASKING: Final = Axis("time of a point (µs)", "point, µs")
ADDING: Final = Axis("time to add a sample (ms)", "add, ms")
SHAPE: Final = Axis("error of the spectrum (1 - GFC)", "1-GFC")
LEVEL: Final = Axis("error of the power (dB rms)", "dB")
_MILLISECONDS: Final = 1e3
_OUTPUTS: Final = 17


@dataclass(frozen=True)
class Plan:
    """What is measured; the defaults are what ``mmt bench networks`` does."""

    plane: str = "wood"
    headings: str = "oak"
    counts: tuple[int, ...] = (20, 50, 100, 200, 500, 1000, 2000)
    compared_at: int = 200
    order: int = 16
    queries: int = 200
    rounds: int = 3
    system_counts: tuple[int, ...] = (100, 200, 500, 1000, 2000)
    changes: int = 2000
    kept: int = 200


def measure(plan: Plan) -> Findings:
    """Measure radial basis networks beside triangulations, in the plane and with headings."""
    panels: list[Panel] = []
    for words, name, has_heading in (
        ("speed and force", plan.plane, False),
        ("velocity and force", plan.headings, True),
    ):
        panels += _panels(words, name, has_heading, plan)
    cost, sequence = _cost(plan), _sequence(plan)
    return Findings(
        name="networks",
        title="Networks against triangles",
        about=(
            f"Samples scattered over the plane of speed and force ({plan.plane}) and over the "
            f"space of velocity and force ({plan.headings}), each with the exact filter of order "
            f"{plan.order} and the exact power there. Errors against the texture itself in "
            f"{plan.queries} other strokes, at a tenth of the largest speed and force or more. "
            "A network's build includes the choice of kernel and "
            "smoothing by leave-one-out error; scipy's has its defaults. What scipy returns is "
            "made a valid filter outside the time. Peers add a sample by building anew."
        ),
        panels=tuple(panels),
        records=(
            Records("cost", f"One system, {_OUTPUTS} outputs over 3 inputs", tuple(cost)),
            Records("sequence", "Samples that come and go", tuple(sequence)),
        ),
        targets=_targets(panels, cost, sequence, plan),
    )


def _strokes(
    count: int, seed: int, least: float, has_heading: bool
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return speeds, forces and headings (count,) of strokes, even over the space.

    None is below the share `least` of the largest speed and force.
    """
    generator = np.random.default_rng(seed)
    power = 2.0 if has_heading else 1.0  # as many strokes in every part of the velocity's disc
    speed = generator.uniform(least**power, 1.0, count) ** (1.0 / power)
    force = generator.uniform(least, 1.0, count)
    heading = generator.uniform(-np.pi, np.pi, count) if has_heading else None
    return speed * MAXIMUM_SPEED_MM_S, force * MAXIMUM_FORCE_N, heading


def _panels(words: str, name: str, has_heading: bool, plan: Plan) -> list[Panel]:
    surface = get_surface(name)
    known = Known(surface, *_strokes(plan.queries, 1, 0.1, has_heading))
    speed, force, heading = _strokes(max(plan.counts) + plan.rounds, 0, 0.05, has_heading)
    samples = exact_samples(surface, speed, force, plan.order, heading)
    level, shape, adding = Curves(), Curves(), Curves()
    for count in plan.counts:
        built, build = _build(part_of(samples, count), plan)
        asked = interleave(
            {method: _bound(method, built[method], known.inputs) for method in METHODS},
            plan.rounds,
        )
        for method, of in METHODS.items():
            answer = of.ask(built[method], known.inputs)
            filters: Filters = of.filters(part_of(samples, count), answer)
            errors = known.errors(*filters)
            level.add(method, count, build[method].times(_MILLISECONDS), errors[1])
            shape.add(method, count, asked[method].times(MICROSECONDS / plan.queries), errors[0])
        for method, times in _add(built, samples, count, plan).items():
            adding.add(method, count, count, times.times(_MILLISECONDS))
    key = "velocity" if has_heading else "speed"
    return [
        Panel(f"{key}_power", f"Power, {words}", "samples", BUILDING, LEVEL, level.done()),
        Panel(f"{key}_spectrum", f"Spectrum, {words}", "samples", ASKING, SHAPE, shape.done()),
        Panel(
            f"{key}_adding", f"A sample more, {words}", "samples", SAMPLES, ADDING, adding.done()
        ),
    ]


def _build(samples: TextureSamples, plan: Plan) -> tuple[dict[str, Any], dict[str, Spread]]:
    """Build by every method, in turns."""
    built: dict[str, Any] = {}
    seconds: dict[str, list[float]] = {method: [] for method in METHODS}
    for _ in range(plan.rounds):
        for method, of in METHODS.items():
            started = time.perf_counter()
            built[method] = of.build(samples)
            seconds[method].append(time.perf_counter() - started)
    return built, {method: spread(np.array(times)) for method, times in seconds.items()}


def _add(
    built: Mapping[str, Any], samples: TextureSamples, count: int, plan: Plan
) -> dict[str, Spread]:
    """Add a sample a round by every method, in turns."""
    seconds: dict[str, list[float]] = {method: [] for method in METHODS}
    grown = dict(built)
    for number in range(plan.rounds):
        more = part_of(samples, count + number + 1)
        for method, of in METHODS.items():
            started = time.perf_counter()
            grown[method] = of.add(grown[method], more)
            seconds[method].append(time.perf_counter() - started)
    return {method: spread(np.array(times)) for method, times in seconds.items()}


def _bound(method: str, built: Any, inputs: FloatArray) -> Callable[[], Any]:
    return lambda: METHODS[method].ask(built, inputs)


def _smooth(count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return points (count, 3) and smooth values (count, m)."""
    generator = np.random.default_rng(seed)
    rotation = generator.standard_normal((3, _OUTPUTS))
    points = generator.random((count, 3))
    return points, np.sin(3.0 * points @ rotation)


def _cost(plan: Plan) -> list[dict[str, Cell]]:
    """Time a solution, and samples that come and go, at every size."""
    rows: list[dict[str, Cell]] = []
    for count in plan.system_counts:
        points, values = _smooth(count + plan.rounds + 1, 2)
        seconds: dict[str, list[float]] = {"solve": [], "add": [], "remove": []}
        for number in range(plan.rounds):
            started = time.perf_counter()
            system = RadialBasisSystem(points[:count], values[:count], RadialBasisSettings("cubic"))
            seconds["solve"].append(time.perf_counter() - started)
            system.add(points[count], values[count])  # grows the arrays
            new = count + 1 + number
            for what, change in (
                ("add", _bound_add(system, points[new], values[new])),
                ("remove", _bound_remove(system, number)),
            ):
                started = time.perf_counter()
                change()
                seconds[what].append(time.perf_counter() - started)
        medians = {what: float(np.median(times)) for what, times in seconds.items()}
        rows.append(
            {
                "samples": count,
                "solve (ms)": medians["solve"] * _MILLISECONDS,
                "add (ms)": medians["add"] * _MILLISECONDS,
                "remove (ms)": medians["remove"] * _MILLISECONDS,
                "solve / add": medians["solve"] / medians["add"],
            }
        )
    return rows


def _bound_add(
    system: RadialBasisSystem, point: FloatArray, value: FloatArray
) -> Callable[[], int]:
    return lambda: system.add(point, value)


def _bound_remove(system: RadialBasisSystem, handle: int) -> Callable[[], None]:
    return lambda: system.remove(handle)


def _sequence(plan: Plan) -> list[dict[str, Cell]]:
    """Let every sample of a network be replaced many times over; compare with one solution."""
    rows: list[dict[str, Cell]] = []
    for settings in (
        RadialBasisSettings("linear"),
        RadialBasisSettings("thin_plate_spline", smoothing=1e-3),
        RadialBasisSettings("cubic"),
        RadialBasisSettings("quintic"),
    ):
        points, values = _smooth(plan.kept + plan.changes // 2, 3)
        system = RadialBasisSystem(points[: plan.kept], values[: plan.kept], settings)
        for number in range(plan.changes // 2):
            system.add(points[plan.kept + number], values[plan.kept + number])
            system.remove(number)
        anew = RadialBasisSystem(points[-plan.kept :], values[-plan.kept :], settings)
        queries, _ = _smooth(plan.queries, 4)
        grown, solved = system.network().at(queries), anew.network().at(queries)
        order = [handles[0] - plan.changes // 2 for handles in system.handles]
        errors = system.leave_one_out() - anew.leave_one_out()[order]
        rows.append(
            {
                "kernel": settings.kernel,
                "changes": plan.changes,
                "solved anew": system.solutions - 1,
                "difference of the network": float(np.abs(grown - solved).max()),
                "difference of leave-one-out errors": float(np.abs(errors).max()),
            }
        )
    return rows


def _targets(
    panels: list[Panel],
    cost: list[dict[str, Cell]],
    sequence: list[dict[str, Cell]],
    plan: Plan,
) -> tuple[Target, ...]:
    targets = []
    for panel in panels:
        if panel.y is LEVEL:
            ours, triangles = (
                {point.knob: point.y.median for point in panel.points(method)}
                for method in (OURS, DELAUNAY)
            )
            at = plan.compared_at
            share = ours[at] / triangles[at] if at in ours and at in triangles else None
            what = f"{panel.title}: error over that of triangles, {at} samples"
            targets.append(Target(what, share, "at most", 1.0))
    ratio = float(cost[-1]["solve / add"] or 0.0)
    targets.append(
        Target(
            f"one solution over one added sample, {cost[-1]['samples']}", ratio, "at least", 10.0
        )
    )
    worst = max(float(row["difference of the network"] or 0.0) for row in sequence)
    targets.append(Target(f"difference after {plan.changes} changes", worst, "at most", 1e-7))
    return tuple(targets)


def run() -> Findings:
    """Measure radial basis networks beside triangulations, in the plane and with headings."""
    return measure(Plan())


EXPERIMENT = Experiment(
    shows="whether radial basis networks are better than triangulations, and what they cost",
    duration="2 min",
    run=run,
    group="bench",
)
