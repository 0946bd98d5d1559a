"""Choose the clock of a recording's messages: their header stamps, or their times of receipt.

Times of several topics can be compared only if all are by one clock. A header's stamp is nearer
to the measurement. But some drivers leave it zero, or take the time since the machine was started,
or that of another machine; and some messages have no header.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mmt.core.arrays import IntArray
from mmt.core.errors import InputError
from mmt.session.importing.stamps import StampChoice

_ONE_CLOCK_NS: Final = 1_000_000_000
"""If the delays from header to receipt of two topics differ by more, they have two clocks."""
_ALIKE_NS: Final = 50_000_000
"""If they differ by more than this, it is said."""
_JUMP_NS: Final = 60_000_000_000
"""If this delay changes by more between two messages, the topic's headers mix several clocks."""
_FEWEST: Final = 16
"""Messages on both sides of a smaller change that show that it lasts, and is no late message."""


class SourceStamps:
    """The stamps of a source's messages, in the order of their receipt.

    Attributes
    ----------
    topic
        Name of the topic, for notes and errors.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._received_ns: list[int] = []
        self._header_ns: list[int] = []

    def stamp(self, received_ns: int, header_ns: int) -> int:
        """Add a message, with a header stamp of 0 if it has none; return its row."""
        self._received_ns.append(received_ns)
        self._header_ns.append(header_ns)
        return len(self._received_ns) - 1

    def times_ns(self, *, receipt: bool) -> IntArray:
        """Return the times (n,) by one of the clocks."""
        return np.array(self._received_ns if receipt else self._header_ns, dtype=np.int64)

    def behind_ns(self) -> IntArray:
        """Return the delays (n,) from header to receipt."""
        return self.times_ns(receipt=True) - self.times_ns(receipt=False)

    def has_two(self) -> bool:
        """Return whether a message has a header stamp and another time of receipt."""
        header_ns, received_ns = self.times_ns(receipt=False), self.times_ns(receipt=True)
        return bool(np.any((header_ns != 0) & (received_ns != 0) & (header_ns != received_ns)))

    def problem(self) -> str:
        """Return why the headers cannot be the clock, empty if they can."""
        missing = sum(stamp == 0 for stamp in self._header_ns)
        if missing == len(self._header_ns):
            return f"{self.topic} has no stamps in its headers"
        if missing:
            return f"{missing} messages of {self.topic} have no stamp in their headers"
        if len(set(self._header_ns)) == 1 < len(self._header_ns):
            return f"the headers of {self.topic} all have one stamp"
        if self._has_steps():
            return f"the headers of {self.topic} are of several clocks, or theirs was set"
        return ""

    def _has_steps(self) -> bool:
        """Return whether the delay jumps, and so does the least delay: messages may be held up."""
        behind_ns = self.behind_ns()
        jumps_ns = np.abs(np.diff(behind_ns))
        lowest = np.minimum.accumulate
        steps_ns = np.abs(lowest(behind_ns)[:-1] - lowest(behind_ns[::-1])[::-1][1:])
        steps_ns[: _FEWEST - 1] = steps_ns[max(0, len(steps_ns) - _FEWEST + 1) :] = 0
        return bool(
            np.any((jumps_ns > _JUMP_NS) | (np.minimum(jumps_ns, steps_ns) > _ONE_CLOCK_NS))
        )


def choose_clock(sources: Sequence[SourceStamps], choice: StampChoice) -> tuple[bool, list[str]]:
    """Return whether to use the times of receipt, and notes on this choice.

    Header stamps are used if every source has them and all agree, unless `choice` names a clock.

    Raises
    ------
    InputError
        Header stamps were chosen, but cannot be used.
    """
    problems = [problem for source in sources if (problem := source.problem())]
    stamped = [source for source in sources if not source.problem()]
    behind = {source: float(np.median(source.behind_ns())) for source in stamped}
    if not problems and behind:
        spread = max(float(np.ptp(source.behind_ns())) for source in stamped)
        first, last = min(behind, key=behind.__getitem__), max(behind, key=behind.__getitem__)
        if behind[last] - behind[first] > max(_ONE_CLOCK_NS, spread):
            problems.append(f"the headers of {first.topic} and {last.topic} are of two clocks")
    if choice == "header" and problems:
        raise InputError(
            f"--stamps header: {problems[0]}; --stamps receipt takes the times of receipt"
        )
    receipt = choice == "receipt" or bool(problems)
    if choice in {"header", "receipt"} or not any(source.has_two() for source in sources):
        return receipt, []  # a person's choice, or there is no other clock
    if receipt:
        return receipt, [f"times are those of receipt: {problems[0]}"]
    later = f"{np.median(list(behind.values())) / 1e6:.3g} ms"
    if behind[last] - behind[first] > _ALIKE_NS:
        each = (f"{behind[source] / 1e6:.3g} ms ({source.topic})" for source in (first, last))
        later = f"{' to '.join(each)}, as if their headers were of two clocks,"
    return receipt, [
        f"times are those of the headers; receipt was {later} later in the middle "
        "(--stamps receipt takes that)"
    ]
