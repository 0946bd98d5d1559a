"""A hostile leader: the follower lives, and gives its robot nothing that it may not."""

import asyncio
import math

import fuzzing
import pytest
from hypothesis import strategies as st

from mmt.follower.service import Follower
from mmt.link.connection import LeaderConnection
from mmt.scene.files import scene_from_tables

LIMIT_MM_S = 200.0


class Watched:
    """A follower in its session whose robot notes what it is told."""

    def __init__(self):
        tables = {
            "link": {"limit_mm_s": LIMIT_MM_S},
            "simulated": {},
            "hand": {},
            "force_feedback": {},
            "network": {},
        }
        self.told = []
        self.service = Follower(scene_from_tables(tables))
        self.service.source.start(0)
        self.client = self.service.client
        self.handlers = {}
        self._step = self.service.source.step
        self.service.source.step = self._note

    def _note(self, elapsed, now_ns, command):
        if command is not None:
            self.told.append(command)
        return self._step(elapsed, now_ns, command)

    async def connect(self):
        """Take the place of the library, which a leader's events come from."""

        async def open_(_, handlers, frequent, timeout_s):
            self.handlers = {**handlers, **frequent}

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(LeaderConnection, "open", open_)
            await self.client.connect(1.0)
        self.client.endpoint.restart()

    def tick(self):
        self.service._tick(1)  # its run would need a leader, and a second for each example


@pytest.fixture(scope="module")
def runner():
    with asyncio.Runner() as made:
        yield made


def test_nothing_that_a_leader_sends_ends_the_follower_or_moves_the_robot_too_fast(runner):
    def attack(messages):
        async def session():
            watched = Watched()
            await watched.connect()
            for event, arguments in messages:
                if event in watched.handlers:
                    watched.handlers[event](*arguments)
                watched.tick()
                await asyncio.sleep(0)
            for _ in range(5):
                watched.tick()
            assert watched.service.ending.fault is None
            assert all(math.isfinite(value) for told in watched.told for value in told)
            steps = zip(watched.told, watched.told[1:], strict=False)
            assert all(math.dist(a, b) <= LIMIT_MM_S / 1000 * 1.01 for a, b in steps)
            assert watched.client.statistics is not None
            await watched.client.disconnect()
            watched.service.source.close()

        runner.run(session())

    anything = st.tuples(st.sampled_from(fuzzing.EVENTS), fuzzing.ARGUMENTS)
    commands = st.lists(fuzzing.COMMANDS, min_size=1, max_size=1)
    messages = st.lists(anything | st.tuples(st.just("commands"), commands), max_size=12)
    assert fuzzing.fuzz(attack, messages) >= 10
