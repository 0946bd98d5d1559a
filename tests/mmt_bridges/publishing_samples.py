"""A part that publishes, in a session whose follower's clock is known, and in real services."""

import asyncio
import json
import os
import subprocess
import sys
from types import SimpleNamespace

from service_processes import LONGEST_S, Service

from mmt.leader.part import Session
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session

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


def run_beside(program, scene, host="127.0.0.1", leading=(), following=(), **variables):
    """Run services beside a program that prints "ready" and writes what it receives into a file.

    `leading` and `following` are commands that run them elsewhere. Return what the program has
    written, the recorded session, and the leader's summary.
    """
    folder = scene.parent
    with Service(
        *("leader", scene, "--json-lines", "--port", 0), cwd=folder, within=leading, **variables
    ) as leader:
        with subprocess.Popen(
            [*leading, sys.executable, "-c", program, str(folder / "received.json")],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **variables},
        ) as recipient:
            try:
                assert recipient.stdout.readline() == "ready\n"
                url = f"http://{host}:{leader.port()}"
                with Service(
                    *("follower", scene, "--json-lines", "--leader", url),
                    cwd=folder,
                    within=following,
                ) as follower:
                    ended = leader.end(), follower.end()
                assert ended == (0, 0), leader.stderr + follower.stderr
                assert recipient.wait(LONGEST_S) == 0
            finally:
                recipient.kill()
        received = json.loads((folder / "received.json").read_text())
        return received, read_session(folder / "session.mcap"), leader.summary()
