"""Detection of changes of surface, and recognition of surfaces met before.

*Alarm.* The innovation of each block under the current surface
(`mmt.texture.surfaces.posterior`) is bet on against those that the surface's earlier blocks had
when they came, and the Shiryaev-Roberts statistic of the bets is followed
(`mmt.texture.surfaces.conformal`). The threshold is the number of possible changes in an hour over
the false alarms that are allowed in it, and a factor for safety: it depends on no texture. The
blocks of the last second or two, which may already be another surface's, are held back. One stroke
alone raises no alarm: what is not known of a surface is alike over a stroke.

*Which surface.* The change-point and the surface that follows are the likeliest, by the Bayes
factor of the blocks since then. A known surface is recalled where its posterior probability,
beside all the others and an unknown one, is high enough, and its own scores do not speak against
it; else the surface is new. A new one is a candidate for its first seconds: where a known one
proves to explain all its blocks, it was that one.
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
from mmt.texture.surfaces.conformal import ShiryaevRoberts
from mmt.texture.surfaces.identification import recognised
from mmt.texture.surfaces.surface import Felt, KnownSurface

WINDOW: Final = 30
"""Number of newest blocks that may contain a change; the current surface learns from older ones."""

CANDIDATE: Final = 100
"""Number of blocks of a new surface after which it is no longer compared with known ones."""

DOUBT: Final = 3.0
"""Evidence below the best at which change-points are still plausible; neither surface learns from
the blocks between them."""

PUT_OFF: Final = 3
"""Blocks more for which it is put off to decide whether a surface is new or a known one."""

_TOGETHER: Final = 10
"""Number of blocks that the current surface learns at a time."""

_COMPARED: Final = 1.3
"""Times as many blocks as at the last comparison, after which a candidate is compared again."""

_FIRST_COMPARED: Final = 4

STROKE: Final = 0.3
"""Distance in u or v from which on strokes are different; blocks of one are a run of bets."""

RUN_SAMPLES: Final = 300
"""Longest run: a stroke of a hand takes about as long."""

SAFETY: Final = 10.0
"""Factor on the mean time between false alarms: what is not known of a surface makes several
innovations alike, which are then not exchangeable. Chosen on the development half of HaTT's models:
at 1 there are some 6 an hour where 1 is allowed, at 10 some 2."""

TOUCHDOWN: Final = 40.0
"""How much likelier a change is before the first block of a contact: there are some 1800 an hour,
and both kinds of change get half of the false alarms."""


class SurfaceDetector:
    """Detector of the surface under the tool, updated block by block.

    Parameters
    ----------
    false_alarms_per_hour
        Expected number of false changes in an hour of stroking, at most.
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
        self._watch = ShiryaevRoberts(
            math.log(SAFETY * 2.0 * 3600.0 / BLOCK_S / false_alarms_per_hour)
        )
        self._window: list[Felt] = []  # the newest of the current surface, oldest first
        self._explained: list[FloatArray] = []
        self._candidate: list[SurfaceBlock] | None = None  # all blocks of a new surface's stay
        self._next_compared = _FIRST_COMPARED
        self._run: SurfaceBlock | None = None
        self._undecided = 0  # blocks to wait for until an alarm is decided

    def update(self, block: SurfaceBlock) -> SurfaceChange | None:
        """Add the next block; return the change that it reveals, if any."""
        self._feel(block)
        if self._candidate is not None:
            self._candidate.append(block)
        innovations = np.array([felt.standardised for felt in self._window])
        bet = self.surfaces[self.current].log_bet(innovations)
        change = self._identify()
        alarm = self._watch.update(
            bet, TOUCHDOWN if block.touchdown else 1.0, new_run=self._begins_run(block)
        )
        if change is None and (alarm or self._undecided):
            change = self._change()
        self._learn()
        return change

    def _begins_run(self, block: SurfaceBlock) -> bool:
        """Say whether a block is of another stroke than those before, or much later."""
        first = self._run
        if first is not None:
            apart = float(np.abs(block.stroke - first.stroke)[:2].max())
            if apart < STROKE and block.start - first.start < RUN_SAMPLES:
                return False
        self._run = block
        return True

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
        """Return the change after an alarm, None where nothing explains the blocks better.

        Where it may yet be a known surface it is put off for `PUT_OFF` blocks.
        """
        if self._undecided > 1:
            self._undecided -= 1
            return None
        identified = self._identify(at_once=True)
        if identified is not None:
            return identified
        blocks = self._blocks()
        others = self._others()
        stayed = np.cumsum([felt.log_density for felt in self._window[::-1]])
        evidence = {
            number: np.cumsum(surface.judge(blocks[::-1])[1]) - stayed
            for number, surface in {0: self._unknown, **others}.items()  # 0: a new one
        }
        likeliest = np.maximum.reduce(list(evidence.values()))
        since = int(np.argmax(likeliest)) + 1
        first_time, self._undecided = not self._undecided, 0
        self._watch.reset()
        if likeliest[since - 1] <= 0.0:
            return None
        number, lead = recognised(self._unknown, others, blocks[-since:])
        if not number and others and lead > -DOUBT and first_time:
            self._undecided = PUT_OFF
            return None
        return self._go(number, since, evidence[number])

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
        self._undecided = 0
        self._watch.reset()

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
