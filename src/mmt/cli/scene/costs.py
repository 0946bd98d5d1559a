"""Measure the costs of a scene's parts: run the scene whole and with parts left out, and compare.

The cost of a part is the difference of means between the runs of the whole scene and those
without the part. The scenes are run in turns, so that all see the same load of the machine. The
variance between runs is estimated from the repetitions of all scenes together (pooled variance
of a one-way layout). Each difference has the half-width of its 95 % confidence interval by
Student's t; a difference that does not exceed the half-width is not significant.
"""

import json
import math
import re
import statistics
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Final

from pydantic import ValidationError

from mmt.core.children import python_command
from mmt.core.errors import MmtError
from mmt.scene import Scene

FIGURES: Final = ("start_s", "core_share", "memory_mb")
"""Seconds until ready, share of a core while streaming, resident memory at the end."""

CONFIDENCE: Final = 0.95

REPEATS: Final = 2
"""Number of fresh processes; the shortest time of each module counts."""

_LONGEST_S: Final = 300.0
_LINE: Final = re.compile(r"import time:\s*(\d+) \|\s*\d+ \|\s*(\S+)")
# the interpreter's own __import__ is timed, importlib's import_module is not
_PROGRAM: Final = """
import contextlib, json, sys
for name in json.load(sys.stdin):
    with contextlib.suppress(ImportError):
        __import__(name)
"""


@dataclass(frozen=True)
class Variant:
    """A scene without one part, and without parts that need it.

    Parameters
    ----------
    left_out
        The part, then those that need it.
    scene
        The remaining scene.
    """

    left_out: tuple[str, ...]
    scene: Scene

    @property
    def name(self) -> str:
        """The part, and in brackets other parts that are left out with it."""
        first, *others = self.left_out
        return f"{first} (with {', '.join(others)})" if others else first


def variants_of(scene: Scene) -> tuple[list[Variant], list[str]]:
    """Return the scenes with one part left out, and the parts that cannot be left out.

    If other parts need the part, the fewest that give a valid scene are left out with it. The
    link and the follower's source are kept: without them there would be only one service.
    """
    parts = [name for name, runs in scene.parts().items() if runs]
    fixed = {"link", scene.source} if scene.link is not None else set()
    loose = [name for name in parts if name not in fixed]
    found = {name: _without(scene, name, loose) for name in loose}
    variants = [variant for variant in found.values() if variant is not None]
    distinct = {frozenset(variant.left_out): variant for variant in reversed(variants)}
    kept = [name for name in parts if found.get(name) is None]
    return [variant for variant in variants if variant in distinct.values()], kept


def _without(scene: Scene, part: str, loose: list[str]) -> Variant | None:
    others = [name for name in loose if name != part]
    for count in range(len(others) + 1):
        for more in combinations(others, count):
            left_out = (part, *more)
            rest = _valid({k: v for k, v in scene.dump().items() if k not in left_out})
            if rest is not None:
                return Variant(left_out, rest)
    return None


def _valid(tables: dict[str, Any]) -> Scene | None:
    try:
        return Scene.model_validate(tables)
    except ValidationError:
        return None


@dataclass(frozen=True)
class MeasuredService:
    """One service in one run."""

    start_s: float
    core_share: float
    memory_mb: float
    modules: tuple[str, ...]
    tasks: Mapping[str, float]
    """Share of samples in which a task was seen, by its name."""
    threads: Mapping[str, float]
    system_threads: int


@dataclass(frozen=True)
class SceneRun:
    """One run of a scene; `services` has "leader" and, if there is a follower, "follower"."""

    services: Mapping[str, MeasuredService]
    bytes_per_s: Mapping[str, float]
    """Sent bytes by direction: "up", "down"."""
    model_from_s: float | None
    """Time at which the model began to drive the vibration, or None if it did not."""
    generator: Mapping[str, Any] | None = None
    """Summary of another package's generator, or None if the scene has none."""


@dataclass(frozen=True)
class CostDifference:
    """Cost of a part, and the half-width of its confidence interval."""

    value: float
    half_width: float

    @property
    def is_significant(self) -> bool:
        """Whether the difference is significant."""
        return abs(self.value) > self.half_width


@dataclass(frozen=True)
class PartCost:
    """Additional cost of one service with a part."""

    figures: Mapping[str, CostDifference]
    modules: tuple[str, ...]
    """Modules that only this part imports."""
    import_s: float


@dataclass
class SceneCosts:
    """All runs, and the costs computed from them."""

    whole: list[SceneRun] = field(default_factory=list)
    variants: dict[str, Variant] = field(default_factory=dict)
    """The scenes with a part left out, by name."""
    without: dict[str, list[SceneRun]] = field(default_factory=dict)
    """Runs of each variant that did not fail, by name."""
    kept: list[str] = field(default_factory=list)
    """Parts that cannot be left out of this scene."""
    failed: dict[str, str] = field(default_factory=dict)
    """Errors of variants that did not run, by name."""
    import_s: dict[str, dict[str, float]] = field(default_factory=dict)
    """Import times by service and module."""

    @property
    def services(self) -> list[str]:
        """The services that the scene has."""
        return list(self.whole[0].services)

    def values(self, service: str, figure: str) -> list[float]:
        """Return a figure of each run of the whole scene."""
        return _values(self.whole, service, figure)

    def part(self, name: str, service: str) -> PartCost:
        """Return the cost of a variant's part in one service."""
        runs = self.without[name]
        left = {name for run in runs for name in run.services[service].modules}
        modules = tuple(m for m in self.whole[0].services[service].modules if m not in left)
        times = self.import_s.get(service, {})
        return PartCost(
            figures={figure: self._difference(runs, service, figure) for figure in FIGURES},
            modules=modules,
            import_s=sum(times.get(module, 0.0) for module in modules),
        )

    def _difference(self, runs: Sequence[SceneRun], service: str, figure: str) -> CostDifference:
        groups = [_values(group, service, figure) for group in (self.whole, *self.without.values())]
        whole, without = self.values(service, figure), _values(runs, service, figure)
        return CostDifference(
            value=statistics.fmean(whole) - statistics.fmean(without),
            half_width=half_width(groups, len(whole), len(without)),
        )


def half_width(groups: Sequence[Sequence[float]], first: int, second: int) -> float:
    """Return the half-width of the confidence interval of a difference of two means.

    Parameters
    ----------
    groups
        Repetitions, assumed to have equal variance; if no group has two, the result is infinite.
    first, second
        Sizes of the two groups that are compared.
    """
    from scipy.special import stdtrit

    freedom = sum(len(group) - 1 for group in groups)
    if freedom < 1:
        return math.inf
    squares = sum(
        math.fsum((value - statistics.fmean(group)) ** 2 for value in group) for group in groups
    )
    quantile = float(stdtrit(freedom, 0.5 + CONFIDENCE / 2))
    return quantile * math.sqrt(squares / freedom * (1 / first + 1 / second))


def measure_scene(
    scene: Scene,
    run: Callable[[Scene], SceneRun],
    *,
    rounds: int,
    parts: bool = True,
    on_step: Callable[[str, int, int], None] = lambda *_: None,
) -> SceneCosts:
    """Run a scene whole and with parts left out, in turns, and time the imports.

    Parameters
    ----------
    scene
        The scene.
    run
        Runs a scene once; raises MmtError if that fails.
    rounds
        Number of runs of each scene; with variants, the whole scene has one more run at the end.
    parts
        Whether to run the scene with parts left out.
    on_step
        Called before each step with its description, its number from 0, and the number of steps.

    Raises
    ------
    MmtError
        The whole scene fails, or the imports cannot be timed.
    """
    variants, kept = variants_of(scene) if parts else ([], [])
    costs = SceneCosts(variants={variant.name: variant for variant in variants}, kept=kept)
    steps = list(_turns(variants, rounds))
    total = len(steps) + len(("leader", "follower") if scene.source else ("leader",))
    for number, variant in enumerate(steps):
        on_step("the whole scene" if variant is None else f"without {variant.name}", number, total)
        if variant is None:
            costs.whole.append(run(scene))
        elif variant.name not in costs.failed:
            _run_variant(costs, variant, run)
    for number, service in enumerate(costs.services, len(steps)):
        on_step(f"imports of the {service}", number, total)
        costs.import_s[service] = import_times_s(costs.whole[0].services[service].modules)
    return costs


def _turns(variants: list[Variant], rounds: int) -> Iterator[Variant | None]:
    """Yield the variants in turns, None for the whole scene; each round starts at another one."""
    for number in range(rounds):
        yield None
        shift = number * len(variants) // rounds
        yield from variants[shift:] + variants[:shift]
    if variants:
        yield None


def _run_variant(costs: SceneCosts, variant: Variant, run: Callable[[Scene], SceneRun]) -> None:
    try:
        finished = run(variant.scene)
        costs.without.setdefault(variant.name, []).append(finished)
    except MmtError as error:
        costs.failed[variant.name] = str(error)
        costs.without.pop(variant.name, None)


def _values(runs: Sequence[SceneRun], service: str, figure: str) -> list[float]:
    return [float(getattr(run.services[service], figure)) for run in runs]


def import_times_s(modules: Sequence[str], repeats: int = REPEATS) -> dict[str, float]:
    """Return the import time of each module (s), without the modules that it imports.

    Parameters
    ----------
    modules
        Modules in the order of their import, as in ``sys.modules``. Modules that cannot be
        imported by name are skipped.
    repeats
        Number of processes that import them.

    Raises
    ------
    MmtError
        A process that imports them fails or hangs.
    """
    times: dict[str, list[float]] = {}
    for _ in range(repeats):
        for microseconds, name in _LINE.findall(_importing(modules)):
            times.setdefault(name, []).append(int(microseconds) * 1e-6)
    return {name: min(times[name]) for name in modules if name in times}


def _importing(modules: Sequence[str]) -> str:
    try:
        ended = subprocess.run(  # noqa: S603 - this interpreter and the program above
            python_command("-X", "importtime", "-c", _PROGRAM),
            input=json.dumps(list(modules)),
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=True,
        )
    except subprocess.SubprocessError as error:
        raise MmtError(f"the imports cannot be timed: {_cost_text(error)}") from error
    return ended.stderr


def _cost_text(error: subprocess.SubprocessError) -> str:
    stderr = getattr(error, "stderr", None)
    lines = stderr.splitlines() if isinstance(stderr, str) else []
    own = [line for line in lines if not line.startswith("import time:")]
    return own[-1] if own else str(error)
