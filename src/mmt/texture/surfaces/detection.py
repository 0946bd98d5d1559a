"""Detection of changes of surface.

How much better are the newest blocks explained by a surface of which nothing is known, from any
change-point on, than by the current one? The Bayes factor answers for each change-point, by the
regressions of `mmt.texture.surfaces.regression`: one of the current surface's blocks, and one
without any. What is not known of a surface is alike over a stroke, and now and then a stroke is not
like what was predicted from the others. So evidence is tempered: its logarithm counts `TEMPER` of
itself (Grunwald, "The safe Bayesian", 2012). A change is detected if it then exceeds the logarithm
of the number of blocks in an hour over the false alarms that are allowed in it. The blocks of the
last second or two, which may already be another surface's, are not learned yet.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.regression import SurfaceRegression, features

WINDOW: Final = 30
"""Number of newest blocks that may contain a change; the regression learns from older ones."""

TEMPER: Final = 0.25
"""Share of the logarithm of a Bayes factor that counts: what is not known of a surface is alike
over a stroke. Chosen on the development half of HaTT's models among 0.2, 0.25, 0.3, 0.4 and 0.5."""

_TOGETHER: Final = 10
"""Number of blocks that are learned at a time."""

_TESTED: Final = 2
"""Number of blocks between two tests."""


class Detection(NamedTuple):
    """A detected change.

    ``from_sample``: the change-point; ``at_sample``: the sample at which it was detected;
    ``evidence``: natural logarithm of the Bayes factor.
    """

    from_sample: int
    at_sample: int
    evidence: float


class SurfaceDetector:
    """Detector of changes of surface, updated block by block.

    Cost: about 40 ms for a second of stroking.

    Parameters
    ----------
    false_alarms_per_hour
        False changes in an hour of stroking that are asked for; see `TEMPER`.
    by_heading
        Whether the texture may depend on the heading.
    """

    def __init__(self, false_alarms_per_hour: float = 1.0, *, by_heading: bool = False) -> None:
        self._directed = by_heading
        self.least_evidence = math.log(3600.0 / BLOCK_S / false_alarms_per_hour) / TEMPER
        self._unknown = SurfaceRegression(directed=by_heading)
        self.window: list[SurfaceBlock] = []
        self.begin(0)

    def begin(self, from_sample: int) -> None:
        """Take the tool to be on another surface since a sample: forget what was before it."""
        self.window = [block for block in self.window if block.start >= from_sample]
        self._current = SurfaceRegression(directed=self._directed)

    def update(self, block: SurfaceBlock) -> Detection | None:
        """Add the next block; return the change that it reveals, if any."""
        self.window.append(block)
        if len(self.window) % _TESTED == 0:
            found = self._test()
            if found is not None:
                return found
        if len(self.window) >= WINDOW + _TOGETHER:
            self._current.learn(*self._arrays(self.window[:_TOGETHER]))
            del self.window[:_TOGETHER]
        return None

    def _arrays(self, blocks: list[SurfaceBlock]) -> tuple[FloatArray, FloatArray]:
        """Return what a regression is given of blocks."""
        rows = features(np.array([block.stroke for block in blocks]), directed=self._directed)
        return rows, np.array([block.values for block in blocks])

    def _test(self) -> Detection | None:
        """Return the likeliest change in the window, if there is evidence enough for one."""
        rows, values = self._arrays(self.window)
        stayed = np.cumsum(self._current.log_densities(rows, values)[::-1])
        # By the chain rule backwards, one pass gives the evidence of the last k blocks for all k.
        evidence = np.cumsum(self._unknown.log_densities(rows[::-1], values[::-1])) - stayed
        since = int(np.argmax(evidence))
        if evidence[since] <= self.least_evidence:
            return None
        first = len(self.window) - 1 - since
        block, at_sample = self.window[first], self.window[-1].stop
        if block.touchdown or first == 0:
            from_sample = min(block.start, max(block.contact_start, 0))
            self.begin(block.start)
        else:  # the block before may be of both surfaces
            from_sample = self.window[first - 1].start
            self.begin(block.stop)
        return Detection(from_sample, at_sample, float(evidence[since]))
