"""Change-point detection between surfaces: a sequential test with a stated false-alarm rate.

For each possible change-point in the last seconds, the hypothesis that the tool has since been on
another surface, known or new, is tested against the one that it has stayed on the current one. The
evidence is the Bayes factor of all blocks since then (`mmt.texture.surfaces.posterior`), maximised
over change-points: a generalised CUSUM (Page 1954; Lorden, "Procedures for reacting to a
change in distribution", Annals of Mathematical Statistics 42, 1971).

*Threshold.* Where the model of the current surface holds, a Bayes factor that starts at a given
moment ever exceeds e^h with a probability of e^-h at most (Ville's inequality), against
each alternative. So with N moments an hour and M alternatives, h = log(N M / rate) gives at most
`rate` false alarms an hour. Lift-offs are natural boundaries: half of the rate is spent on the
touchdowns, which are few, and half on all the other blocks.

Change-points within contact in the first `YOUNG` blocks of a stay get a smaller share, by
e^-`EARLY`: the posterior of a surface is then still mostly the prior.

The evidence must hold with some blocks left out (`robustness`), and where blocks
have headings more is asked for.

*Afterwards.* The alternative of most evidence is taken. It learns what came after the last moment
that is plausible, the former one what came before the likeliest. A new surface is a candidate for
its first blocks (`mmt.texture.surfaces.candidate`): where a known one predicts all of them better
than nothing known by `SURE`, and better than every other known one, it was that one. Where blocks
have headings a known surface is not recalled from a few, in which it may look like another; till
then the surface is a new one.
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
"""Number of newest blocks that may contain a change; the current surface learns from older ones."""

SURE: Final = 7.0
"""Evidence (natural logarithm) needed for a recall, against a new surface and every other one."""


class _Caution(NamedTuple):
    """Additional evidence needed where blocks have headings: along some, many surfaces are alike.

    ``alarm``, ``recall``, ``trial``: for a change, for a known surface, for a candidate.
    ``blocks``: least number of blocks of a stay from which a known surface is recalled.
    """

    alarm: float = 2.0
    recall: float = 1.5
    trial: float = 3.0
    blocks: int = 8


MIXED: Final = 2
"""Number of first blocks of a candidate that may belong to the former surface."""

YOUNG: Final = 20
"""Number of first blocks of a stay in which a change within contact needs more evidence."""

EARLY: Final = 3.0
"""Additional evidence (natural logarithm) in these blocks, when little is known of the surface."""

DOUBT: Final = 3.0
"""Evidence below the best at which change-points are still plausible; neither surface learns from
the blocks between them."""

_TOGETHER: Final = 5
"""Number of blocks that the current surface learns at a time."""

_TOUCHDOWNS_PER_HOUR: Final = 1800.0
_RATE_HZ: Final = 1000.0


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
        """Known surfaces by number; the most recently touched one is last."""
        self._stayed = 0  # blocks of this stay
        self._window: list[SurfaceBlock] = []  # the newest of the current surface, oldest first
        self._candidate: Candidate | None = Candidate()
        self._unknown = SurfacePosterior(self._settings)

    def update(self, block: SurfaceBlock) -> SurfaceChange | None:
        """Add the next block; return the change that it reveals, if any."""
        window = self._window
        window.append(block)
        self._stayed += 1
        if self._candidate is not None:
            self._candidate.blocks.append(block)
        change = self._decide(self._weigh()) or self._identify()
        if change is None and len(window) >= WINDOW + _TOGETHER:
            self.surfaces[self.current].add(window[:_TOGETHER])
            del window[:_TOGETHER]
        return change

    def threshold(self, *, touchdown: bool, young: bool = False) -> float:
        """Return the evidence (natural logarithm) needed for a change.

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

        The evidence is that of the newest block, the newest two, and so on, given the blocks
        before them.
        """
        newest_first = PreparedBlocks.of(self._window[::-1], self._settings)
        oldest_first = PreparedBlocks.of(self._window, self._settings)
        stayed = self.surfaces[self.current].log_likelihood_after(oldest_first)[::-1]
        others = {n: k for n, k in self.surfaces.items() if n != self.current}
        if self._candidate is not None and others:
            self._candidate.compare(self._unknown, others)
            stayed = self._candidate.after(stayed)
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
        candidate = self._candidate
        if number and candidate is not None and since >= len(candidate) - MIXED:
            found = float(evidence[number][since - 1])
            return self._identified(named, candidate.blocks[-since:], found) if named else None
        if since < 2 or evidence[number][since - 1] <= threshold:
            return None
        other = self.surfaces[number] if number else self._unknown
        check = RobustnessCheck(blocks, since, self.surfaces[self.current], other)
        if not check.above(threshold, at_any_heading=bool(number) and blocks[-since].touchdown):
            return None
        if named and candidate is not None and (gain := candidate.gains()[named]) > 0.0:
            return self._identified(named, candidate.blocks, gain)  # it was on that one before
        return self._change(named, since, evidence[number], margins)

    def _best_since(self, evidence: Mapping[int, FloatArray], since: int) -> int:
        """Return the number of the known surface identified with certainty, 0 for a new one."""
        at = {number: float(values[since - 1]) for number, values in evidence.items()}
        ranked = sorted(at, key=lambda n: at[n], reverse=True)
        if ranked[0] and at[ranked[0]] - at[ranked[1]] < SURE + self._caution.recall:
            return 0
        return ranked[0]

    def _change(
        self, number: int, since: int, evidence: FloatArray, margins: FloatArray
    ) -> SurfaceChange:
        """Change to another surface, and estimate the certain and the earliest change-point."""
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
        self._candidate = None if number else Candidate(self._window)
        self._go_to(change.surface)
        return change

    def _go_to(self, number: int) -> None:
        self.current = number
        self.surfaces[number] = self.surfaces.pop(number, SurfacePosterior(self._settings))
        if len(self.surfaces) > self._most:
            del self.surfaces[next(iter(self.surfaces))]

    # --- identification of a new surface

    def _identify(self) -> SurfaceChange | None:
        """Return the change if the candidate proves to be a known surface."""
        candidate = self._candidate
        if candidate is None:
            return None
        if len(candidate) >= LONGEST:
            self._candidate = None
        if not candidate.is_compared or len(candidate) < max(2, self._caution.blocks):
            return None
        number, lead = candidate.leading()
        if lead < SURE + self._caution.trial + math.log(len(self.surfaces) - 1):
            return None
        return self._identified(number, candidate.blocks, lead)

    def _identified(
        self, number: int, blocks: list[SurfaceBlock], evidence: float
    ) -> SurfaceChange:
        """Merge the candidate into a known surface, which learns these of its blocks."""
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
        self._candidate = None
        self._go_to(number)
        return change
