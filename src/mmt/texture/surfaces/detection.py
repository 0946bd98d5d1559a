"""Has the tool come onto another surface: a sequential test with a stated false-alarm rate.

For each moment in the last seconds the hypothesis that the tool has been on another surface ever
since, a known one or a new one, stands against the one that it has stayed on the current one. The
evidence is the Bayes factor of all blocks since that moment (`mmt.texture.surfaces.posterior`),
and the largest counts: a generalised CUSUM (Page 1954; Lorden, "Procedures for reacting to a
change in distribution", Annals of Mathematical Statistics 42, 1971).

*Threshold.* Where the current surface's model holds, a Bayes factor that is followed from
one moment on ever exceeds e^h with a probability of e^-h at most (Ville's inequality), against
each alternative. So with N moments an hour and M alternatives, h = log(N M / rate) gives at most
`rate` false alarms an hour. Lift-offs are natural boundaries: half of the rate is spent on the
touchdowns, which are few, and half on all the other blocks.

Moments within contact in the first `YOUNG` blocks of a stay get less, by e^-`EARLY`: what is known
of a surface by then is mostly the prior.

The evidence must hold with some blocks left out (`robustness`), and where blocks
have headings more is asked for.

*Afterwards.* The alternative of most evidence is taken. It learns what came after the last moment
that is plausible, the former one what came before the likeliest. A new surface is on trial for its
first blocks (`mmt.texture.surfaces.candidate`): where a known one predicts all of them better than
nothing known by `SURE`, and better than every other known one, it was that one. Where blocks have
headings a known surface is not recalled from a few, in which it may look like another; till then
the surface is a new one.
"""

import itertools
import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.surfaces.block_likelihood import PreparedBlocks
from mmt.texture.surfaces.blocks import BLOCK, SurfaceBlock
from mmt.texture.surfaces.candidate import LONGEST, Candidate
from mmt.texture.surfaces.changes import SurfaceChange, change_point
from mmt.texture.surfaces.posterior import SurfacePosterior
from mmt.texture.surfaces.prior import GRAINED, SETTINGS
from mmt.texture.surfaces.robustness import RobustnessCheck

WINDOW: Final = 20
"""Blocks that are looked back; older ones are what the current surface is learned from."""

SURE: Final = 7.0
"""Evidence (natural logarithm) that a recall takes, against a new surface and every other one."""


class _Caution(NamedTuple):
    """How much more evidence is asked for where blocks have headings: along some, many are alike.

    ``alarm``, ``recall``, ``trial``: of a change, of a known surface, of one on trial.
    ``blocks``: so many of a stay a known surface takes.
    """

    alarm: float = 2.0
    recall: float = 1.5
    trial: float = 3.0
    blocks: int = 8


MIXED: Final = 2
"""First blocks of a trial that may be of the former surface."""

YOUNG: Final = 20
"""Blocks of a stay in which a change within contact takes more evidence."""

EARLY: Final = 3.0
"""So much more, for of a surface that was just met the least is known."""

DOUBT: Final = 3.0
"""Change points with so much less evidence are plausible too; in between nothing is learned."""

_TOGETHER: Final = 5
"""Blocks that the current surface learns at a time."""

_TOUCHDOWNS_PER_HOUR: Final = 1800.0
_RATE_HZ: Final = 1000.0


class SurfaceDetector:
    """Follow on which surface the tool is, block by block.

    Parameters
    ----------
    false_alarms_per_hour
        How often a change may be found where there is none, in an hour of stroking.
    most
        Surfaces that are kept, at least 2; for one more, that on which the tool was not for
        longest is forgotten.
    by_heading
        Whether blocks have headings, on which a texture may depend.

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
        self._rate = false_alarms_per_hour
        self._most = most
        self._settings = np.concatenate([SETTINGS, GRAINED]) if by_heading else SETTINGS
        self._caution = _Caution() if by_heading else _Caution(0.0, 0.0, 0.0, 0)
        self._numbers = itertools.count(1)
        self.current = next(self._numbers)
        self.surfaces: dict[int, SurfacePosterior] = {
            self.current: SurfacePosterior(self._settings)
        }
        """Those that are known, by number; the one that the tool was on last stands last."""
        self._stayed = 0  # blocks of this stay
        self._window: list[SurfaceBlock] = []  # the newest of the current surface, oldest first
        self._trial: Candidate | None = Candidate()
        self._unknown = SurfacePosterior(self._settings)

    def update(self, block: SurfaceBlock) -> SurfaceChange | None:
        """Take the next block; return the change that it brings to light."""
        window = self._window
        window.append(block)
        self._stayed += 1
        if self._trial is not None:
            self._trial.blocks.append(block)
        change = self._decide(self._weigh()) or self._identify()
        if change is None and len(window) >= WINDOW + _TOGETHER:
            self.surfaces[self.current].add(window[:_TOGETHER])
            del window[:_TOGETHER]
        return change

    def threshold(self, *, touchdown: bool, young: bool = False) -> float:
        """Return the evidence (natural logarithm) that a change takes.

        Parameters
        ----------
        touchdown
            Whether it is to have happened while the tool was off the surface.
        young
            Whether it is to have happened in the first `YOUNG` blocks of the stay.
        """
        per_hour = _TOUCHDOWNS_PER_HOUR if touchdown else 3600.0 * _RATE_HZ / BLOCK
        more = self._caution.alarm + (EARLY if young and not touchdown else 0.0)
        return math.log(2.0 * per_hour * len(self.surfaces) / self._rate) + more

    # --- alarms

    def _weigh(self) -> dict[int, FloatArray]:
        """Return, by surface (0 for a new one), the evidence for it since each block, newest first.

        Of the newest block, the newest two, and so on, given what came before them.
        """
        newest_first = PreparedBlocks.of(self._window[::-1], self._settings)
        oldest_first = PreparedBlocks.of(self._window, self._settings)
        stayed = self.surfaces[self.current].log_likelihood_after(oldest_first)[::-1]
        others = {n: k for n, k in self.surfaces.items() if n != self.current}
        if self._trial is not None and others:
            self._trial.ask(self._unknown, others)
            stayed = self._trial.after(stayed)
        others[0] = self._unknown
        return {n: k.log_likelihood(newest_first) - stayed for n, k in others.items()}

    def _decide(self, evidence: Mapping[int, FloatArray]) -> SurfaceChange | None:
        blocks = self._window
        first = self._stayed - len(blocks)
        margins = np.array(
            [
                -self.threshold(touchdown=block.touchdown, young=first + place < YOUNG)
                for place, block in enumerate(blocks)
            ]
        )[::-1]
        best = {number: float((values + margins).max()) for number, values in evidence.items()}
        leading = max(best, key=lambda n: best[n])
        if best[leading] <= 0.0:
            return None
        since = int(np.argmax(evidence[leading] + margins)) + 1
        threshold = -float(margins[since - 1])
        number = self._best_since(evidence, since)
        named = number if since >= self._caution.blocks else 0
        if number and self._trial is not None and since >= len(self._trial) - MIXED:
            found = float(evidence[number][since - 1])
            return self._identified(named, self._trial.blocks[-since:], found) if named else None
        if since < 2 or evidence[number][since - 1] <= threshold:
            return None
        other = self.surfaces[number] if number else self._unknown
        held = RobustnessCheck(blocks, since, self.surfaces[self.current], other)
        if not held.above(threshold, at_any_heading=bool(number) and blocks[-since].touchdown):
            return None
        if named and self._trial is not None and (gain := self._trial.gains()[named]) > 0.0:
            return self._identified(named, self._trial.blocks, gain)  # so it was there all along
        return self._change(named, since, evidence[number], margins)

    def _best_since(self, evidence: Mapping[int, FloatArray], since: int) -> int:
        """Return the known surface that is surely meant, 0 for a new one."""
        at = {number: float(values[since - 1]) for number, values in evidence.items()}
        ranked = sorted(at, key=lambda n: at[n], reverse=True)
        if ranked[0] and at[ranked[0]] - at[ranked[1]] < SURE + self._caution.recall:
            return 0
        return ranked[0]

    def _change(
        self, number: int, since: int, evidence: FloatArray, margins: FloatArray
    ) -> SurfaceChange:
        """Go to another surface: from when on it surely is, and from when on perhaps."""
        blocks = self._window
        earliest = len(blocks) - since
        plausible = evidence + margins >= evidence[since - 1] + margins[since - 1] - DOUBT
        first = len(blocks) - (1 + int(np.argmax(plausible)))
        # The block in which it happened may be of both.
        alone = first if blocks[first].touchdown else first + 1
        change = SurfaceChange(
            kind="recalled" if number else "new",
            before=self.current,
            surface=number or next(self._numbers),
            from_sample=change_point(blocks, first),
            since_sample=blocks[min(alone, len(blocks) - 1)].start,
            at_sample=blocks[-1].stop,
            evidence=float(evidence[since - 1]),
        )
        self.surfaces[self.current].add(blocks[: max(earliest - 1, 0)])
        self._window = blocks[alone:]
        self._stayed = len(self._window)
        self._trial = None if number else Candidate(self._window)
        self._go_to(change.surface)
        return change

    def _go_to(self, number: int) -> None:
        self.current = number
        self.surfaces[number] = self.surfaces.pop(number, SurfacePosterior(self._settings))
        if len(self.surfaces) > self._most:
            del self.surfaces[next(iter(self.surfaces))]

    # --- the trial of a new surface

    def _identify(self) -> SurfaceChange | None:
        """Say whether the surface on trial is a known one."""
        trial = self._trial
        if trial is None:
            return None
        if len(trial) >= LONGEST:
            self._trial = None
        if not trial.asked or len(trial) < max(2, self._caution.blocks):
            return None
        number, lead = trial.leading()
        if lead < SURE + self._caution.trial + math.log(len(self.surfaces) - 1):
            return None
        return self._identified(number, trial.blocks, lead)

    def _identified(
        self, number: int, blocks: list[SurfaceBlock], evidence: float
    ) -> SurfaceChange:
        """Take the surface on trial for a known one, which learns these of its blocks."""
        change = SurfaceChange(
            kind="identified",
            before=self.current,
            surface=number,
            from_sample=blocks[0].start,
            since_sample=blocks[0].start,
            at_sample=blocks[-1].stop,
            evidence=evidence,
        )
        del self.surfaces[self.current]
        waiting = min(len(blocks), len(self._window))
        self.surfaces[number].add(blocks[: len(blocks) - waiting])
        self._window = blocks[len(blocks) - waiting :]
        self._stayed = len(blocks)
        self._trial = None
        self._go_to(number)
        return change
