"""What listeners behind a network feel, against what the operator feels at the same motion.

``python -m mmt_lab.sharing.felt URL SECONDS COUNT PROFILE`` lets one listener take the model on
this machine, and so many behind an emulated network, until the leader ends its session or for so
long, and prints as JSON what is found. Listeners render to the sample what the leader does at the
same motion with the same model; so what differs is which state of the model each has, moment by
moment.
"""

import asyncio
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from functools import cache
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.evaluation.levels import BAND_EDGES_HZ, band_errors_db, root_mean_square
from mmt.scene import Network
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.harness.proxy import Proxy
from mmt_share.client import STATES_HZ, ListenerClient
from mmt_share.tables import Listening

STEP_NS: Final = 50_000_000
"""From moment to moment."""
_MOST_INPUTS: Final = 60
_FREQUENCIES_HZ: Final = np.arange(BAND_EDGES_HZ[0], BAND_EDGES_HZ[-1] + 1.0)

Course = Sequence[tuple[int, int]]
"""When each state of the model was there (ns), and its number; in order."""

Pair = tuple[int, int]
"""Numbers of the states that the operator and a listener have."""


def states(course: Course, times_ns: Sequence[int]) -> list[int]:
    """Return the numbers of what is rendered at times; 0 before the first state."""
    place = np.searchsorted([at for at, _ in course], times_ns, side="right")
    return [course[index - 1][1] if index else 0 for index in place.tolist()]


def pairs(operator: Course, listener: Course, end_ns: int) -> Counter[Pair]:
    """Count the moments with each pair, from the listener's first state to the end."""
    if not listener:
        return Counter()
    times = range(listener[0][0], end_ns, STEP_NS)
    return Counter(zip(states(operator, times), states(listener, times), strict=True))


def errors_db(
    models: Mapping[int, TextureModel], inputs: FloatArray, counts: Mapping[Pair, int]
) -> FloatArray:
    """Return the root mean square over bands and inputs of each moment's error, in dB.

    Parameters
    ----------
    models
        The states by their numbers.
    inputs
        Speed (mm/s) and force (N), shape (k, 2).
    counts
        How many moments there are with each pair of states; without those before the operator
        has a model, or with one that is not known.

    Returns
    -------
    FloatArray
        Shape (n,), one for each moment.
    """

    @cache
    def density(state: int) -> FloatArray:
        return models[state].spectrum(*inputs.T, frequencies_hz=_FREQUENCIES_HZ)

    found: list[float] = []
    for (own, heard), moments in counts.items():
        if {own, heard} <= models.keys():
            difference = band_errors_db(density(heard), density(own), _FREQUENCIES_HZ)
            found += moments * [root_mean_square(difference)]
    return np.array(found)


class Ear:
    """A listener that notes when it has which model.

    Parameters
    ----------
    url
        Where the model is shared.
    on_end
        Called when the session is over.
    keeps
        Whether it keeps the models and the hand's motion.
    """

    def __init__(self, url: str, on_end: Callable[[], None], *, keeps: bool = False) -> None:
        self.made: list[tuple[int, int]] = []
        self.had: list[tuple[int, int]] = []
        self._building: dict[int, asyncio.Future[TextureModel]] = {}
        self.inputs: list[tuple[float, float]] = []
        self._keeps, self._on_end = keeps, on_end
        self.client = ListenerClient(
            Listening(url=url, patience_s=60.0),
            on_model=self._take,
            on_state=self._see,
            on_event=self._hear,
            states_hz=None if keeps else STATES_HZ,
        )

    async def models(self) -> dict[int, TextureModel]:
        """Return the models by their numbers."""
        return {number: await model for number, model in self._building.items()}

    def _take(self) -> None:
        replica = self.client.replica
        if replica.about is None or not replica.about.ready:
            return
        self.made.append((replica.made_ns, replica.number))
        self.had.append((time.monotonic_ns(), replica.number))
        if self._keeps:  # in a thread: the others of this process listen on
            self._building[replica.number] = asyncio.ensure_future(asyncio.to_thread(replica.build))

    def _see(self, state: RecordArray) -> None:
        speed_mm_s = float(np.hypot(*state["velocity_mm_s"][:2]))
        if self._keeps and state["contact"] and speed_mm_s > 10.0:
            self.inputs.append((speed_mm_s, float(state["force_n"])))

    def _hear(self, text: str) -> None:
        if "has ended" in text:
            self._on_end()


async def listen(url: str, count: int, longest_s: float, profile: str) -> dict[str, Any]:
    """Listen until the end; return what was found."""
    ended = asyncio.Event()
    asyncio.get_running_loop().call_later(longest_s, ended.set)
    settings = Network.model_validate({"profile": profile})
    async with AsyncExitStack() as stack:
        proxy = await stack.enter_async_context(Proxy(int(url.rpartition(":")[2]), settings))
        operator = Ear(url, ended.set, keeps=True)
        distant = [Ear(f"http://127.0.0.1:{proxy.port}", lambda: None) for _ in range(count)]
        for ear in (operator, *distant):
            await ear.client.connect()
            stack.push_async_callback(ear.client.close)
        await ended.wait()
        end_ns = time.monotonic_ns()
    delay_ns = round(1e6 * settings.delay_ms)
    found = judged(operator, distant, await operator.models(), end_ns, delay_ns)
    return found | {"repeated": proxy.repeated}


def judged(
    operator: Ear,
    distant: Sequence[Ear],
    models: Mapping[int, TextureModel],
    end_ns: int,
    delay_ns: int,
) -> dict[str, Any]:
    """Return the figures of all that are distant, and of one whom the delay alone keeps behind."""
    step = max(1, len(operator.inputs) // _MOST_INPUTS)
    inputs = np.array(operator.inputs[::step]).reshape(-1, 2)
    counts = [pairs(operator.made, ear.had, end_ns) for ear in distant]
    total: Counter[Pair] = sum(counts, Counter())
    delayed = pairs(operator.made, [(at + delay_ns, n) for at, n in operator.made], end_ns)
    moments = sum(total.values())
    same = sum(n for (own, heard), n in total.items() if own == heard)
    lags = [1e-6 * (had - made) for ear in distant for (had, _), (made, _) in _both(ear)]
    return {
        "listeners": sum(bool(ear.had) for ear in distant),
        "behind_at_end": sum(bool(ear.had) and _last(ear) != _last(operator) for ear in distant),
        "same_share": same / moments if moments else None,
        "errors_db": errors_db(models, inputs, total).tolist() if len(inputs) else [],
        "delay_errors_db": errors_db(models, inputs, delayed).tolist() if len(inputs) else [],
        "lags_ms": lags,
        "wholes": sum(ear.client.wholes for ear in distant),
        "changes": sum(ear.client.changes for ear in distant),
    }


def _both(ear: Ear) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    # the first is as old as the leader's last change
    return list(zip(ear.had, ear.made, strict=True))[1:]


def _last(ear: Ear) -> int:
    return ear.had[-1][1] if ear.had else 0


def main() -> None:
    """Listen as the command line says."""
    url, longest_s, count, profile = sys.argv[1:5]
    print(json.dumps(asyncio.run(listen(url, int(count), float(longest_s), profile))))


if __name__ == "__main__":
    main()
