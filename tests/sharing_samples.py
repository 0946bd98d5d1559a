"""Models that grow, and a server of them, for the tests of sharing."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np

from mmt.scene.sharing_tables import Listening, Sharing
from mmt.sharing.client import ListenerClient
from mmt.sharing.messages import About
from mmt.sharing.publishing import ModelPublisher
from mmt.sharing.relay import Relay
from mmt.sharing.server import SharingServer
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.model.inputs import ISOTROPIC
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel

LONGEST_S = 30.0
WELCOME = {"session_id": "abc", "name": "a table", "rate_hz": 1000}


def model_of(count: int, order: int = 6) -> TextureModel:
    """A model whose first samples are those of a smaller one."""
    table = np.array([np.random.default_rng(n).uniform(-0.8, 0.8, order + 3) for n in range(count)])
    reflection = np.ascontiguousarray(table[:, :order])
    variance = 1.0 + table[:, order] ** 2
    inputs = np.column_stack([150.0 + 150.0 * table[:, -2], 1.5 + table[:, -1]])
    return TextureModel(
        TextureSamples(
            inputs,
            reflection_to_lsf(reflection),
            variance,
            output_power(variance, reflection),
            ISOTROPIC,
        )
    )


def about(samples: int, *, ready: bool = True) -> About:
    return About("abc", float(samples), ready, None, samples, "completion sum 5.00", False)


async def until(happened: Callable[[], object]) -> None:
    async with asyncio.timeout(LONGEST_S):
        while not happened():
            await asyncio.sleep(0.005)


@dataclass
class Shared:
    """A server that shares a model, in this process."""

    server: SharingServer
    relay: Relay
    said: list[str] = field(default_factory=list)
    publisher: ModelPublisher = field(default_factory=ModelPublisher)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.port}"

    def publish(self, count: int, *, ready: bool = True) -> None:
        self.relay.offer_model(*self.publisher.publish(model_of(count), about(count, ready=ready)))


@asynccontextmanager
async def shared(**settings: object) -> AsyncIterator[Shared]:
    """Share on any free port."""
    said: list[str] = []
    relay = Relay()
    table = Sharing.model_validate({"port": 0, **settings})
    server = SharingServer(table, relay, WELCOME, lambda text, _: said.append(text))
    await server.start()
    try:
        yield Shared(server, relay, said)
    finally:
        await server.stop()


@dataclass
class Heard:
    """A listener, and what it has heard."""

    client: ListenerClient
    said: list[str]
    models: list[int]
    states: list[float]


@asynccontextmanager
async def listening(url: str, **settings: object) -> AsyncIterator[Heard]:
    """Listen there until the end of the block."""
    said: list[str] = []
    models: list[int] = []
    states: list[float] = []
    table = Listening.model_validate({"url": url, "patience_s": 5.0, **settings})
    client = ListenerClient(
        table,
        on_model=lambda: models.append(client.replica.number),
        on_state=lambda state: states.append(float(state["time_s"])),
        on_event=said.append,
    )
    await client.connect()
    try:
        yield Heard(client, said, models, states)
    finally:
        await client.close()
