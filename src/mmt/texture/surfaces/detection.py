"""Detection of changes of surface.

For each change-point, a Bayes factor compares two explanations of the blocks from there on: an
unknown surface, and the current one. Both are regressions of `mmt.texture.surfaces.regression`, one
without blocks, one of the current surface's blocks. Prediction errors are alike over a stroke, and
now and then a stroke differs from the prediction. So evidence is tempered: its logarithm is
multiplied by `TEMPER` (Grunwald, "The safe Bayesian", 2012). A change is detected if the result
exceeds the logarithm of the number of blocks in an hour over the false alarms allowed in an hour.
The blocks of the last second or two may already be another surface's, and are not learned yet.
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
"""Factor on the logarithm of a Bayes factor, since prediction errors are alike over a stroke.
Chosen on the development half of HaTT's models among 0.2, 0.25, 0.3, 0.4 and 0.5."""

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
        False changes that are allowed in an hour of stroking; see `TEMPER`.
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
        """Begin another surface at a sample, and forget all blocks before it."""
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
        """Return the features and values of blocks for a regression."""
        rows = features(np.array([block.stroke for block in blocks]), directed=self._directed)
        return rows, np.array([block.values for block in blocks])

    def _test(self) -> Detection | None:
        """Return the likeliest change in the window, if there is evidence enough for one."""
        rows, values = self._arrays(self.window)
        stayed = np.cumsum(self._current.log_densities(rows, values)[::-1])
        # By the chain rule, one backward pass gives the evidence of the last k blocks for all k.
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
