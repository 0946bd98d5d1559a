"""Models that grow, and a server of them, for the tests of sharing."""

import asyncio
import time
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from mmt.core.errors import MmtError
from mmt.link.protocol import encode_event
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import ISOTROPIC, TextureSamples
from mmt_share.client import ListenerClient
from mmt_share.messages import CHANGE, MODEL, STATE, STATE_DTYPE, ModelDescription
from mmt_share.parts.sharing import ModelPublisher
from mmt_share.player.following import shared_player
from mmt_share.player.results import ResultsFile
from mmt_share.player.server import PlayerServer
from mmt_share.relay import Relay
from mmt_share.server import SharingServer
from mmt_share.tables import Listening, Sharing

LONGEST_S = 30.0
LISTENS = "mmt_share.commands.listener"
ENDED = "the shared session has ended: completed: the last state stays"
WELCOME = {"session_id": "abc", "name": "a table", "rate_hz": 1000}


def samples_of(numbers, order=6, space=ISOTROPIC):
    """Samples, each of which depends on its number alone."""
    table = np.array([np.random.default_rng(n).uniform(-0.8, 0.8, order + 3) for n in numbers])
    reflection = np.ascontiguousarray(table[:, :order])
    variance = 1.0 + table[:, order] ** 2
    speed_mm_s, heading_rad = 150.0 + 150.0 * table[:, -2], np.pi * table[:, order]
    inputs = space.from_motion(
        speed_mm_s * np.cos(heading_rad), speed_mm_s * np.sin(heading_rad), 1.5 + table[:, -1]
    )
    return TextureSamples(
        inputs, reflection_to_lsf(reflection), variance, output_power(variance, reflection), space
    )


def model_of(count, order=6):
    """A model whose first samples are those of a smaller one."""
    return TextureModel(samples_of(range(count), order))


def about(samples, *, ready=True):
    return ModelDescription(
        "abc", float(samples), ready, None, samples, "completion sum 5.00", False
    )


async def until(happened):
    async with asyncio.timeout(LONGEST_S):
        while not happened():
            await asyncio.sleep(0.005)


@dataclass
class Shared:
    """A server that shares a model, in this process."""

    server: SharingServer
    relay: Relay
    said: list[str] = field(default_factory=list)
    details: list[dict[str, Any]] = field(default_factory=list)
    publisher: ModelPublisher = field(default_factory=ModelPublisher)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.port}"

    def publish(self, count, *, ready=True):
        self.offer(model_of(count), about(count, ready=ready))

    def offer(self, model, said):
        self.relay.offer_model(*self.publisher.publish(model, said))

    def offer_state(self, time_s, force_n=0.0, speed_mm_s=0.0, position_mm=(0.0, 0.0, 0.0)):
        state = np.zeros(1, STATE_DTYPE)
        state["position_mm"] = position_mm
        state["velocity_mm_s"][0, 0] = speed_mm_s
        state["time_s"], state["force_n"], state["contact"] = time_s, force_n, force_n > 0.0
        message = encode_event(STATE, state.tobytes())
        self.relay.offer_state(message, time_s, time.monotonic_ns())


@asynccontextmanager
async def shared(**settings):
    """Share on any free port."""
    said = []
    details = []

    def take(text, more):
        said.append(text)
        details.append(more)

    relay = Relay()
    table = Sharing.model_validate({"port": 0, **settings})
    server = SharingServer(table, relay, WELCOME, take)
    await server.start()
    try:
        yield Shared(server, relay, said, details)
    finally:
        await server.stop()


@asynccontextmanager
async def playing_shared(sharing, directory):
    """Serve the page that plays what is shared."""
    results = ResultsFile(directory / "results.csv")
    async with shared_player(Listening(url=sharing.url), results, sharing.said.append) as player:
        server = PlayerServer(player, several=True)
        await server.start("127.0.0.1", 0)
        try:
            yield server
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
async def listening(url, operator=None, states_hz=None, **settings):
    """Listen there until the end of the block."""
    said = []
    models = []
    states = []
    table = Listening.model_validate({"url": url, "patience_s": 5.0, **settings})

    def take(event, message):
        if event == STATE:
            states.append(float(np.frombuffer(message, STATE_DTYPE)["time_s"][0]))
        elif event in {MODEL, CHANGE}:
            models.append(client.replica.number)

    client = ListenerClient(
        table,
        on_message=take,
        on_event=said.append,
        operator=operator,
        states_hz=states_hz,
    )
    await client.connect()
    try:
        yield Heard(client, said, models, states)
    finally:
        await client.close()


async def refused(words, url, operator=None, **settings):
    """Nobody can listen there, for a reason in these words."""
    with pytest.raises(MmtError, match=words):
        async with listening(url, operator, **settings):
            pass
