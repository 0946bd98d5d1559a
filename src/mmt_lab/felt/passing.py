"""A hand, a network, a follower and the way back through the leader's code, tick by tick.

The hand and the follower are the simulated ones. Each message is delayed or lost as by the
emulated network of the services. Nothing here depends on how the leader makes vibration, so that
one passage serves every method.
"""

import heapq
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray, Vector
from mmt.core.frames import CHANNELS
from mmt.leader.building import LeaderParts
from mmt.leader.part import Session
from mmt.leader.parts import build_parts
from mmt.link.emulated.impairments import MessageImpairments
from mmt.scene import (
    Actuator,
    Hand,
    Link,
    Network,
    Playout,
    Rendering,
    Scene,
    SessionTable,
    Simulated,
    Texture,
)
from mmt.testing.simulation import PERIOD_NS, RATE_HZ, nominal_compliance_mm_n
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface, Stroke
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import Inputs, ModellingSettings

COMMAND_BYTES: Final = 60
FRAME_BYTES: Final = 80
"""Size of a message with one command or frame, which matters if bandwidth is limited."""

NEVER_TICK: Final = 2**40


@dataclass(frozen=True)
class Passage:
    """One session over a network, as the leader sees it.

    Attributes
    ----------
    surface
        The texture.
    velocity_mm_s, force_n
        Velocity of the hand over the surface and its force, shape (n, 2) and (n,).
    frames
        Frames that the follower sent, shape (n,).
    arrival_tick
        When each frame arrives first, shape (n,); `NEVER_TICK` for one that was lost.
    """

    surface: KnownSurface
    velocity_mm_s: FloatArray
    force_n: FloatArray
    frames: RecordArray
    arrival_tick: IntArray

    @property
    def speed_mm_s(self) -> FloatArray:
        """The hand's speed over the surface, shape (n,)."""
        return np.hypot(self.velocity_mm_s[:, 0], self.velocity_mm_s[:, 1])

    @property
    def heading(self) -> FloatArray:
        """Unit vectors along the hand's velocity, shape (n, 2); along x while the hand rests."""
        speed = self.speed_mm_s
        moving = speed > 0.0
        length = np.where(moving, speed, 1.0)[:, None]
        unit = np.where(moving[:, None], self.velocity_mm_s / length, 0.0)
        unit[~moving, 0] = 1.0
        return unit


def stroke_over_network(
    surface: KnownSurface, network: Network, ticks: int, seed: int, stroking: Hand | None = None
) -> Passage:
    """Let a hand stroke a surface over a network for `ticks` milliseconds."""
    settings = Simulated()
    compliance_mm_n = nominal_compliance_mm_n(settings)
    hand = SimulatedHand(stroking or Hand(), seed, compliance_mm_n=compliance_mm_n)
    follower = SimulatedFollower(settings, channels=CHANNELS, seed=seed, surface=surface)
    follower.start(0)
    down = MessageImpairments(network, seed, 0)
    up = MessageImpairments(network, seed + 1, 0)
    under_way: list[tuple[int, int, Vector]] = []
    newest, command = -1, None
    motion = np.empty((ticks, 3))
    arrivals = np.full(ticks, NEVER_TICK)
    frames = []
    for tick in range(ticks):
        now_ns = tick * PERIOD_NS
        state = hand.read(1)
        motion[tick] = *state.velocity_mm_s[:2], state.force_n if state.contact else 0.0
        for arrival_ns in down.arrivals_ns(now_ns, COMMAND_BYTES):
            heapq.heappush(under_way, (arrival_ns, tick, state.position_mm))
        while under_way and under_way[0][0] <= now_ns:
            _, number, position_mm = heapq.heappop(under_way)
            if number > newest:
                newest, command = number, position_mm
        frames.append(follower.step(1, now_ns, command))
        due_ns = min(up.arrivals_ns(now_ns, FRAME_BYTES), default=None)
        if due_ns is not None:
            arrivals[tick] = -(-due_ns // PERIOD_NS)
    return Passage(surface, motion[:, :2], motion[:, 2], np.concatenate(frames), arrivals)


BACKFILL_TICKS: Final = 250
"""Delay of the back-fill of a lost frame beyond the longest way there and back."""

UPDATE_TICKS: Final = 50
"""Ticks from a model's last frame until it is in use."""


def undelayed_vibration(passage: Passage, seed: int) -> FloatArray:
    """Return the surface's vibration (n,) at the hand's own speed and force, without a delay.

    It is a separate realisation: no rendering from a model can come nearer to the texture.
    """
    surface = passage.surface.vibration(np.random.default_rng([seed, 77]))
    motion = zip(
        passage.speed_mm_s.tolist(),
        passage.force_n.tolist(),
        passage.heading.tolist(),
        np.cumsum(passage.velocity_mm_s / RATE_HZ, axis=0).tolist(),
        strict=True,
    )
    return np.array(
        [
            surface.step(Stroke(speed, force, (u, v), (x, y)))[0]
            for speed, force, (u, v), (x, y) in motion
        ]
    )


def leader_vibration(
    passage: Passage, models: Mapping[int, TextureModel] | None, seed: int
) -> tuple[FloatArray, float | None]:
    """Return the vibration (n,) that a leader plays from a passage, and when a model took over.

    Parameters
    ----------
    passage
        The frames with their arrivals, and the hand's motion.
    models
        The models to render, by the tick from which each is used; None to play the stream alone.
    seed
        Seed of the synthesis and of the concealment.
    """
    ticks = len(passage.frames)
    parts = _leader(seed, renders=models is not None)
    stream, vibration, rendering = parts.playout, parts.vibration, parts.synthesizing
    assert stream is not None and vibration is not None  # noqa: S101, PT018 - the scene has both
    switch = vibration.switch
    directed = not passage.surface.isotropic
    drives = passage.velocity_mm_s.T if directed else passage.speed_mm_s[None]
    inputs = np.vstack([drives, passage.force_n])
    order = np.argsort(passage.arrival_tick, kind="stable")
    arrived = np.searchsorted(passage.arrival_tick[order], np.arange(ticks), side="right").tolist()
    output = np.empty(ticks)
    taken, start_s = 0, None
    for tick in range(ticks):
        if models is not None and rendering is not None and tick in models:
            rendering.synthesizer.model = models[tick]
            switch.use_model(True)
            start_s = tick / RATE_HZ if start_s is None else start_s
        for index in order[taken : arrived[tick]]:
            stream.on_frames(passage.frames[index : index + 1], tick * PERIOD_NS)
        taken = arrived[tick]
        output[tick] = switch.render(tick * PERIOD_NS, *inputs[:, tick : tick + 1])[0]
    return output, start_s


def _leader(seed: int, *, renders: bool) -> LeaderParts:
    """Return the leader's own parts that play, with the scene's defaults."""
    scene = Scene(
        session=SessionTable(seed=seed),
        link=Link(),
        simulated=Simulated(),
        hand=Hand(),
        texture=Texture(),
        rendering=Rendering() if renders else None,
        playout=Playout(),
        actuator=Actuator(),
    )
    return build_parts(Session(scene), ("playout", "synthesizing", "vibration"))


def local_models(passage: Passage, texture: Mapping[str, Any]) -> dict[int, TextureModel]:
    """Return the local models from the start criterion on, by the tick from which each is in use.

    An update takes the frames of one second, delimited by sequence numbers. As in the leader's
    modelling, it waits until lost frames are filled in. ``texture`` has keys of that table.
    """
    inputs: Inputs = "isotropic" if passage.surface.isotropic else "anisotropic"
    modeller, models = OnlineModeller(ModellingSettings(inputs=inputs, **texture)), {}
    period = round(RATE_HZ)
    come = _filled_in(passage.arrival_tick)
    for first in range(0, len(passage.frames) - period + 1, period):
        update = modeller.update(passage.frames[first : first + period])
        if update.started and (model := update.model) is not None:
            models[int(come[: first + period].max()) + UPDATE_TICKS] = model
        if update.stopped:
            break
    return models


def _filled_in(arrival_tick: IntArray) -> IntArray:
    """Return the tick at which each frame has come; lost frames come by back-fill."""
    sent = np.arange(len(arrival_tick))
    lost = arrival_tick == NEVER_TICK
    longest = int((arrival_tick - sent)[~lost].max()) if not lost.all() else 0
    return np.where(lost, sent + 2 * longest + BACKFILL_TICKS, arrival_tick)
