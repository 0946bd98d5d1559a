"""A hand, a network, a follower and the way back, tick by tick in simulated time.

The hand and the follower are the simulated ones. Each message is delayed or lost as by the
emulated network of the services. Nothing here depends on how the leader makes vibration, so that
one passage serves every method.
"""

import heapq
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray, RecordArray, Vector
from mmt.core.frames import CHANNELS
from mmt.link.emulated.impairments import MessageImpairments
from mmt.scene import Hand, Network, Simulated
from mmt.testing.simulation import PERIOD_NS, nominal_compliance_mm_n
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.known_surfaces import KnownSurface

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
