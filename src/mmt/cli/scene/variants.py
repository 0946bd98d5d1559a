"""A scene with one part left out at a time, wherever it is still a scene."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

from pydantic import ValidationError

from mmt.scene import Scene


@dataclass(frozen=True)
class Variant:
    """A scene without one part, and without those that need it.

    Parameters
    ----------
    left_out
        The part, then what had to go with it.
    scene
        What is left.
    """

    left_out: tuple[str, ...]
    scene: Scene

    @property
    def name(self) -> str:
        """The part, and in brackets what goes with it."""
        first, *others = self.left_out
        return f"{first} (with {', '.join(others)})" if others else first


def variants_of(scene: Scene) -> tuple[list[Variant], list[str]]:
    """Return the scenes with one part left out, and the parts that cannot be.

    Where others need the part, the fewest that make a valid scene are left out with it. The
    link and the follower's source stay: without them a scene of two services is another one.
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
