"""A part that publishes, in a session whose follower's clock is known."""

import asyncio
from types import SimpleNamespace

from mmt.leader.part import Session
from mmt.scene.files import scene_from_tables

OFFSET_NS = 5_000_000_000_123


class Publishing:
    """The part of a kind, with what it has said."""

    def __init__(self, kind, parts, **tables):
        self.said = []
        scene = scene_from_tables({"link": {}, "simulated": {}, "hand": {}, **tables})
        self.session = Session(scene, self.said.append, lambda: 1.25)
        self.remote = SimpleNamespace(clock_offset_ns=OFFSET_NS, follower_time_ns=0)
        self.session.remote = self.remote
        self.part = kind.build(self.session, parts)
        self.session.parts.add(self.part)
        self.part.connect()

    def send(self, frames, follower_time_ns=None):
        newest_ns = int(frames["time_ns"][-1])
        self.remote.follower_time_ns = newest_ns if follower_time_ns is None else follower_time_ns
        self.part.on_frames(frames, 0)

    def end(self):
        """End the part; return its figures."""
        asyncio.run(self.part.stop())
        self.part.close()
        return self.part.summary(1.0)[self.part.table]
