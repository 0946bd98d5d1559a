"""Paper B's two scenarios (section 3.4): the order of the textures, and the participants' answers.

Exploration: the participant compares each real sample, in random order, with its texture, and rates
the realism of the pair. Matching: the tiles are shuffled and show no pictures; for each real sample
the participant names the tile that feels like it. Then the pictures are shown, the matches are
counted, and the realism is rated once. The scale from 1 to 7 is not from the paper.
"""

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt_share.player.results import Value, now_utc

BEST: Final = 7
"""Best rating; the worst is 1."""
MOST_TILES: Final = 26
LEAST_STROKED_S: Final = 1.0
"""How long a texture must have been stroked before it is rated."""


def label(tile: int) -> str:
    """Return the name of a tile: A, B, C."""
    return chr(ord("A") + tile)


Write = Callable[[Mapping[str, Value]], object]


def orders(seed: int, participant: str, scenario: str, count: int) -> tuple[list[int], list[int]]:
    """Return two random orders of `count` textures, the same for the same arguments."""
    text = f"{seed}\n{participant}\n{scenario}".encode()
    digest = int.from_bytes(hashlib.sha256(text).digest())
    random = np.random.default_rng(digest)
    return random.permutation(count).tolist(), random.permutation(count).tolist()


class Study(ABC):
    """One participant's run of a scenario.

    Parameters
    ----------
    names
        The textures.
    participant
        Name of the participant, for the results.
    seed
        Seed of the orders, together with participant and scenario.
    write
        Called with each row of the results; if it raises, the study stays unchanged.
    clock
        Monotonic time (s).
    """

    scenario = ""

    def __init__(
        self,
        names: Sequence[str],
        participant: str,
        seed: int,
        write: Write,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.names = tuple(names)
        self.participant = participant
        self.seed = seed
        self.done = False
        self._write = write
        self._clock = clock
        self._begun_utc = now_utc()
        self._since_s = clock()
        self.order, self._shuffled = orders(seed, participant, self.scenario, len(names))
        """Real samples in the order of the questions, and the texture under each tile."""
        self._stroked_s = [0.0] * len(names)
        self._row("begin")

    @property
    def hidden(self) -> bool:
        """Whether the page must not show which texture a tile is."""
        return False

    def texture(self, tile: int) -> int | None:
        """Return the texture under a tile, or None if the tile is disabled now."""
        return tile

    def stroked(self, tile: int, seconds: float) -> None:
        """Add to the time that a tile was stroked."""
        self._stroked_s[tile] += seconds

    def leave(self) -> None:
        """Record that the participant leaves the run early, unless the run is done."""
        if not self.done:
            self._row("leave")

    def answer(self, sample: int, tile: int) -> str:
        """Record the tile that feels like a real sample; return a message for the page.

        Raises
        ------
        InputError
            Nothing is matched now.
        """
        raise InputError(f"nothing is matched now (sample {sample}, tile {tile})")

    def finish(self) -> str:
        """Show the pictures; return a message for the page.

        Raises
        ------
        InputError
            There is nothing to finish.
        """
        raise InputError("there is nothing to finish")

    @abstractmethod
    def rate(self, rating: int) -> str:
        """Record a rating of realism, 1 to 7; return a message for the page.

        Raises
        ------
        InputError
            Nothing can be rated yet, or all is rated already.
        """

    def state(self) -> dict[str, Any]:
        """Return the state for the page; if `hidden`, it plays the `textures` without names."""
        return {
            "scenario": self.scenario,
            "participant": self.participant,
            "hidden": self.hidden,
            "done": self.done,
            "textures": [self.texture(tile) for tile in range(len(self.names))],
        }

    def _row(self, event: str, **values: Value) -> None:
        self._write(
            {
                "time_utc": now_utc(),
                "participant": self.participant,
                "scenario": self.scenario,
                "begun_utc": self._begun_utc,
                "seed": self.seed,
                "event": event,
                "elapsed_s": round(self._clock() - self._since_s, 3),
                **values,
            }
        )


class Exploration(Study):
    """Rate pairs of a real and a rendered texture, one after the other."""

    scenario = "exploration"
    trial = 0
    """Number of the current pair, from 0."""

    def texture(self, tile: int) -> int | None:
        """Return the texture under the current pair's tile, or None under the others."""
        return tile if self.done or tile == self.order[self.trial] else None

    def rate(self, rating: int) -> str:
        """Record the pair's rating, and go on to the next pair; see `Study.rate`."""
        if self.done:
            raise InputError("all pairs are rated")
        texture = self.order[self.trial]
        if not self._may_rate:
            raise InputError(f"stroke {self.names[texture]} first, for a second at least")
        self._row(
            "rating",
            trial=self.trial + 1,
            sample=self.names[texture],
            tile=label(texture),
            texture=self.names[texture],
            rating=rating,
            stroked_s=round(self._stroked_s[texture], 3),
        )
        self._since_s = self._clock()
        if self.trial + 1 == len(self.order):
            self.done = True
            return f"all {len(self.order)} pairs are rated, thank you"
        self.trial += 1
        return f"rated {rating}: now {self.names[self.order[self.trial]]}"

    def state(self) -> dict[str, Any]:
        """Return the state for the page."""
        return {
            **super().state(),
            "trial": self.trial + 1,
            "trials": len(self.order),
            "tile": None if self.done else self.order[self.trial],
            "rates": self._may_rate,
        }

    @property
    def _may_rate(self) -> bool:
        return not self.done and self._stroked_s[self.order[self.trial]] >= LEAST_STROKED_S


class Matching(Study):
    """Find the tile of each real sample, without pictures."""

    scenario = "matching"

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.tiles: dict[int, int] = {}
        """Tile that was named, by real sample."""
        self.matches: int | None = None
        self._answers = 0
        super().__init__(*arguments, **options)

    @property
    def hidden(self) -> bool:
        """Whether the page must not show which texture a tile is."""
        return self.matches is None

    def texture(self, tile: int) -> int | None:
        """Return the texture that was shuffled under a tile."""
        return self._shuffled[tile]

    def answer(self, sample: int, tile: int) -> str:
        """Record a match; a tile matched to another sample is freed first."""
        if self.matches is not None:
            raise InputError("the pictures are shown: no match can be changed any more")
        self._row(
            "answer",
            trial=self._answers + 1,
            sample=self.names[sample],
            tile=label(tile),
            texture=self.names[self._shuffled[tile]],
            correct=int(self._shuffled[tile] == sample),
            stroked_s=round(self._stroked_s[tile], 3),
        )
        self._answers += 1
        self._since_s = self._clock()
        self.tiles = {other: its for other, its in self.tiles.items() if its != tile}
        self.tiles[sample] = tile
        return f"{self.names[sample]} is tile {label(tile)}"

    def finish(self) -> str:
        """Show the pictures and count the matches; see `Study.finish`."""
        if self.matches is not None:
            raise InputError("the matches are counted already")
        lacking = len(self.names) - len(self.tiles)
        if lacking:
            raise InputError(f"{lacking} samples have no tile yet")
        matches = sum(self._shuffled[tile] == sample for sample, tile in self.tiles.items())
        self._row("finish", trial=self._answers, correct=matches)
        self.matches = matches
        return f"{matches} of {len(self.names)} match"

    def rate(self, rating: int) -> str:
        """Record the rating of all textures together; see `Study.rate`."""
        if self.matches is None:
            raise InputError("match all samples first")
        if self.done:
            raise InputError("it is rated already")
        self._row("rating", rating=rating)
        self.done = True
        return "thank you"

    def state(self) -> dict[str, Any]:
        """Return the state for the page."""
        return {
            **super().state(),
            "samples": self.order,
            "tiles": {str(sample): tile for sample, tile in self.tiles.items()},
            "matches": self.matches,
            "rates": self.matches is not None and not self.done,
        }


SCENARIOS: Final[dict[str, type[Study]]] = {
    study.scenario: study for study in (Exploration, Matching)
}
