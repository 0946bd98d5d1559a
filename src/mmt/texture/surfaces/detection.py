"""Detection of changes of surface, and recognition of surfaces met before.

*Alarm.* How much better are the newest blocks explained by another surface, from any change-point
on? The Bayes factor of a surface of which nothing is known, over the current one
(`mmt.texture.surfaces.posterior`), answers for each change-point, and where that is above 1 those
of the known surfaces are asked as well. What is not known of a surface is alike over a stroke, and
now and then a stroke is not like what was predicted from the others. So evidence is tempered: its
logarithm counts `TEMPER` of itself. A change is found where it then exceeds the logarithm of the
number of blocks in an hour over the false alarms that are allowed in it. The blocks of the last
second or two, which may already be another surface's, are held back.

*Which surface.* The change-point and the surface that follows are the likeliest. A known surface is
recalled where its posterior probability, beside all the others and an unknown one, is high enough;
else the surface is new. A new one is a candidate for its first seconds: where a known one proves to
explain all its blocks, it was that one. One that is left again before it filled a window is
forgotten.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.changes import SurfaceChange, change_point
from mmt.texture.surfaces.identification import recognised
from mmt.texture.surfaces.surface import Felt, KnownSurface

WINDOW: Final = 30
"""Number of newest blocks that may contain a change; the current surface learns from older ones."""

TEMPER: Final = 0.4
"""Share of the logarithm of a Bayes factor that counts: what is not known of a surface is alike
over a stroke. Chosen on the development half of HaTT's models among 0.33, 0.4 and 0.43."""

CANDIDATE: Final = 100
"""Number of blocks of a new surface after which it is no longer compared with known ones."""

DOUBT: Final = 3.0
"""Evidence below the best at which change-points are still plausible; neither surface learns from
the blocks between them."""

_TOGETHER: Final = 10
"""Number of blocks that the current surface learns at a time."""

_ASKED: Final = 2
"""Number of blocks after which it is asked again whether there was a change: asking is dear."""

_COMPARED: Final = 1.3
"""Times as many blocks as at the last comparison, after which a candidate is compared again."""

_FIRST_COMPARED: Final = 4


class SurfaceDetector:
    """Detector of the surface under the tool, updated block by block.

    Parameters
    ----------
    false_alarms_per_hour
        False changes in an hour of stroking that are asked for; see `TEMPER`.
    most
        Largest number of surfaces kept, at least 2; beyond, the least recently touched one is
        dropped.
    by_heading
        Whether the texture may depend on the heading.

    Raises
    ------
    InputError
        The rate is not above 0, or fewer than two surfaces are to be kept.
    """

    def __init__(
        self, false_alarms_per_hour: float = 1.0, most: int = 20, *, by_heading: bool = False
    ) -> None:
        if not (math.isfinite(false_alarms_per_hour) and false_alarms_per_hour > 0.0):
            raise InputError(
                f"false_alarms_per_hour is {false_alarms_per_hour}: it must be above 0"
            )
        if most < 2:
            raise InputError(f"most is {most}: at least two surfaces must be kept")
        self._most = most
        self._directed = by_heading
        self._numbers = itertools.count(1)
        self.current = next(self._numbers)
        self.surfaces = {self.current: KnownSurface(directed=by_heading)}
        """Known surfaces by number; the most recently touched one is last."""
        self._unknown = KnownSurface(directed=by_heading)
        self._least_evidence = math.log(3600.0 / BLOCK_S / false_alarms_per_hour) / TEMPER
        self._window: list[Felt] = []  # the newest of the current surface, oldest first
        self._explained: list[FloatArray] = []
        self._candidate: list[SurfaceBlock] | None = None  # all blocks of a new surface's stay
        self._next_compared = _FIRST_COMPARED

    def update(self, block: SurfaceBlock) -> SurfaceChange | None:
        """Add the next block; return the change that it reveals, if any."""
        self._feel(block)
        if self._candidate is not None:
            self._candidate.append(block)
        change = self._identify()
        if change is None and len(self._window) % _ASKED == 0:
            change = self._change()
        self._learn()
        return change

    def _feel(self, block: SurfaceBlock) -> None:
        """Add a block to the window, by what the current surface says of it."""
        surface = self.surfaces[self.current]
        blocks = [*self._blocks(), block]
        self._explained.append(surface.explained([block]))
        self._window.append(surface.newest(blocks, np.concatenate(self._explained, axis=-1)))

    def _learn(self) -> None:
        """Let the current surface learn what is older than the window."""
        surface = self.surfaces[self.current]
        while len(self._window) >= WINDOW + _TOGETHER:
            surface.learn(self._window[:_TOGETHER])
            del self._window[:_TOGETHER]
            self._explained = [surface.explained([block]) for block in self._blocks()]

    def _others(self) -> dict[int, KnownSurface]:
        return {n: surface for n, surface in self.surfaces.items() if n != self.current}

    def _blocks(self) -> list[SurfaceBlock]:
        return [felt.block for felt in self._window]

    # --- changes

    def _change(self) -> SurfaceChange | None:
        """Return the change that explains the newest blocks so much better, if any does."""
        blocks = self._blocks()
        stayed = np.cumsum([felt.log_density for felt in self._window[::-1]])

        def evidence(surface: KnownSurface) -> FloatArray:
            return np.asarray(np.cumsum(surface.log_densities(blocks[::-1])) - stayed)

        found = {0: evidence(self._unknown)}  # 0: a new one
        if found[0].max() <= 0.0:
            return None
        others = self._others()
        found |= {number: evidence(surface) for number, surface in others.items()}
        likeliest = np.maximum.reduce(list(found.values()))
        since = int(np.argmax(likeliest)) + 1
        if likeliest[since - 1] <= self._least_evidence:
            return None
        identified = self._identify(at_once=True)
        if identified is not None:
            return identified
        number, _ = recognised(self._unknown, others, blocks[-since:])
        return self._go(number, since, found[number])

    def _go(self, number: int, since: int, evidence: FloatArray) -> SurfaceChange:
        """Change to another surface, and estimate the certain and the earliest change-point."""
        blocks = self._blocks()
        plausible = np.flatnonzero(evidence >= evidence[since - 1] - DOUBT)
        earliest = len(blocks) - 1 - int(plausible[-1])
        first = len(blocks) - since
        # The block in which it happened may be of both.
        alone = first if blocks[first].touchdown else first + 1
        alone = min(alone, len(blocks) - 1)
        change = SurfaceChange(
            kind="recalled" if number else "new",
            before=self.current,
            surface=number or next(self._numbers),
            from_sample=change_point(blocks, first),
            since_sample=blocks[alone].start,
            at_sample=blocks[-1].stop,
            evidence=float(evidence[since - 1]),
        )
        if self._candidate is not None and len(self._candidate) - since < WINDOW:
            del self.surfaces[self.current]
        else:
            self.surfaces[self.current].learn(self._window[: max(earliest - 1, 0)])
        self._stay(change.surface, blocks[alone:], candidate=not number)
        return change

    def _stay(self, number: int, blocks: Sequence[SurfaceBlock], *, candidate: bool) -> None:
        """Take the tool to be on a surface since the first of these blocks."""
        self.current = number
        self.surfaces[number] = self.surfaces.pop(number, KnownSurface(directed=self._directed))
        if len(self.surfaces) > self._most:
            del self.surfaces[next(iter(self.surfaces))]
        self._window, self._explained = [], []
        for block in blocks:
            self._feel(block)
        self._candidate = list(blocks) if candidate else None
        self._next_compared = _FIRST_COMPARED

    # --- identification of a new surface

    def _identify(self, *, at_once: bool = False) -> SurfaceChange | None:
        """Return the change if the candidate proves to be a known surface."""
        blocks = self._candidate
        others = self._others()
        if blocks is None or not others or not (at_once or len(blocks) >= self._next_compared):
            return None
        self._next_compared = max(len(blocks) + 1, round(_COMPARED * len(blocks)))
        number, lead = recognised(self._unknown, others, blocks)
        if not number:
            if len(blocks) >= CANDIDATE:
                self._candidate = None
            return None
        change = SurfaceChange(
            kind="identified",
            before=self.current,
            surface=number,
            from_sample=blocks[0].start,
            since_sample=blocks[0].start,
            at_sample=blocks[-1].stop,
            evidence=lead,
        )
        del self.surfaces[self.current]
        self._stay(number, blocks, candidate=False)
        self._learn()
        return change
