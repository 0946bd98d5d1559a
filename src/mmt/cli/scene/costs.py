"""Measure the costs of a scene's parts: run the scene whole and with parts left out, and compare.

The cost of a part is the difference of means between the runs of the whole scene and those
without the part. The scenes are run in turns, so that all see the same load of the machine. The
variance between runs is estimated from the repetitions of all scenes together (pooled variance
of a one-way layout). Each difference has the half-width of its 95 % confidence interval by
Student's t.
"""

import math
import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Final

from pydantic import ValidationError

from mmt.cli.scene.description import describe_scene
from mmt.core.errors import MmtError
from mmt.scene import Scene

OF_PROCESSES: Final = ("core_share", "memory_mb")
FIGURES: Final = ("start_s", *OF_PROCESSES)
"""Seconds until ready, share of a core while streaming, resident memory at the end."""

_CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class SceneRun:
    """One run of a scene; ``figures`` has, by service, those of `FIGURES`."""

    figures: Mapping[str, Mapping[str, float]]
    modules: Mapping[str, frozenset[str]]
    """By service: the modules that it has imported at its end."""
    bytes_per_s: Mapping[str, float]
    """Sent bytes by direction: "up", "down"."""
    model_from_s: float | None
    """Time at which the model began to drive the vibration, or None if it did not."""


@dataclass(eq=False)
class Variant:
    """A scene without one part, and without parts that need it; its runs, or why it failed.

    ``left_out`` is the part, then those that need it; empty for the whole scene.
    """

    left_out: tuple[str, ...]
    scene: Scene
    runs: list[SceneRun] = field(default_factory=list)
    failed: str = ""

    @property
    def name(self) -> str:
        """The part, and in brackets other parts that are left out with it."""
        first, *others = self.left_out
        return f"{first} (with {', '.join(others)})" if others else first

    def values(self, service: str, figure: str) -> list[float]:
        """Return one figure of a service in each run."""
        return [run.figures[service][figure] for run in self.runs]


@dataclass(frozen=True)
class SceneCosts:
    """A scene as it ran whole, and with parts left out; ``kept`` are parts that cannot be."""

    whole: Variant
    variants: Sequence[Variant] = ()
    kept: Sequence[str] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as JSON values: of each service, of each part, and of the link."""
        runs = self.whole.runs
        return {
            "runs": len(runs),
            "duration_s": self.whole.scene.session.duration_s,
            "services": {service: self._service(service) for service in runs[0].figures},
            "bytes_per_s": {
                way: statistics.fmean(run.bytes_per_s[way] for run in runs)
                for way in runs[0].bytes_per_s
            },
            "parts": {
                variant.name: {
                    "left_out": list(variant.left_out),
                    "bytes_per_s": self._added_bytes_per_s(variant.scene),
                    **{service: self._part(variant, service) for service in runs[0].figures},
                }
                for variant in self.variants
                if variant.runs
            },
            "remarks": self._remarks(),
        }

    def _service(self, service: str) -> dict[str, Any]:
        modules = self.whole.runs[0].modules[service]
        figures: dict[str, Any] = {
            figure: {"mean": statistics.fmean(values), "least": min(values), "most": max(values)}
            for figure in FIGURES
            for values in [self.whole.values(service, figure)]
        }
        return {**figures, "modules": len(modules), "packages": packages_of(modules)}

    def _part(self, variant: Variant, service: str) -> dict[str, Any]:
        left = set().union(*(run.modules[service] for run in variant.runs))
        modules = self.whole.runs[0].modules[service] - left
        figures = {figure: self._difference(variant, service, figure) for figure in FIGURES}
        return {**figures, "modules": len(modules), "packages": packages_of(modules)}

    def _difference(self, variant: Variant, service: str, figure: str) -> dict[str, Any]:
        groups = [each.values(service, figure) for each in (self.whole, *self.variants)]
        whole, without = groups[0], variant.values(service, figure)
        value = statistics.fmean(whole) - statistics.fmean(without)
        around = half_width([group for group in groups if group], len(whole), len(without))
        return {"difference": value, "half_width": around, "seen": abs(value) > around}

    def _added_bytes_per_s(self, without: Scene) -> dict[str, float]:
        """Return by direction how much more the scene sends than without a part, as computed."""
        whole, rest = (
            {stream.way: stream.bytes_per_s for stream in describe_scene(scene).streams}
            for scene in (self.whole.scene, without)
        )
        return {way: value - rest.get(way, 0.0) for way, value in whole.items()}

    def _remarks(self) -> list[str]:
        scene = self.whole.scene
        failed = [each for each in self.variants if each.failed]
        sentences = [f"{each.name}: not measured, {each.failed}" for each in failed]
        if len(failed) < len(self.variants):
            if self.kept:
                sentences.append(
                    f"{', '.join(self.kept)}: cannot be left out of this scene, "
                    "so what they cost by themselves is not known"
                )
            sentences.append(
                "parts share what they import and do: their costs need not add up to the whole's"
            )
        began = any(run.model_from_s is not None for run in self.whole.runs)
        if scene.rendering is not None and not began:
            sentences.append(
                f"rendering: no model was in use within {scene.session.duration_s:g} s, so "
                "its share of a core is not in the figures; take a longer --duration"
            )
        return sentences


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
            tables = {k: v for k, v in scene.dump().items() if k not in left_out}
            try:
                return Variant(left_out, Scene.model_validate(tables))
            except ValidationError:
                continue
    return None


def measure_scene(
    scene: Scene,
    run: Callable[[Scene], SceneRun],
    *,
    rounds: int,
    parts: bool = True,
    on_step: Callable[[str, int, int], None] = lambda *_: None,
) -> SceneCosts:
    """Run a scene whole and with parts left out, in turns.

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
        The whole scene fails.
    """
    variants, kept = variants_of(scene) if parts else ([], [])
    whole = Variant((), scene)
    steps = list(_turns(whole, variants, rounds))
    for number, variant in enumerate(steps):
        name = "the whole scene" if variant is whole else f"without {variant.name}"
        on_step(name, number, len(steps))
        if variant.failed:
            continue
        try:
            variant.runs.append(run(variant.scene))
        except MmtError as error:
            if variant is whole:
                raise
            variant.failed = str(error)
            variant.runs.clear()
    return SceneCosts(whole, variants, kept)


def _turns(whole: Variant, variants: list[Variant], rounds: int) -> Iterator[Variant]:
    """Yield the scenes to run; each round starts at another variant."""
    for number in range(rounds):
        yield whole
        shift = number * len(variants) // rounds
        yield from variants[shift:] + variants[:shift]
    if variants:
        yield whole


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
    squares = sum(statistics.pvariance(group) * len(group) for group in groups)
    quantile = float(stdtrit(freedom, 0.5 + _CONFIDENCE / 2))
    return quantile * math.sqrt(squares / freedom * (1 / first + 1 / second))


def packages_of(modules: Iterable[str]) -> list[str]:
    """Return the packages of modules, without the standard library, mmt and private packages."""
    tops = {name.partition(".")[0] for name in modules} - sys.stdlib_module_names - {"mmt"}
    public = (name for name in tops if not name.startswith("_") and name.isidentifier())
    return sorted(public, key=str.lower)
