"""The services as processes, as a person or a program starts them."""

import json
import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

CONFIGS = Path(__file__).parents[2] / "configs"
LONGEST_S = 60.0
"""No wait in these tests lasts longer; a first start compiles the numerics beforehand."""


def scene(name):
    """The path of an example scene."""
    return str(CONFIGS / f"{name}.toml")


class Service:
    """A command of mmt as a process; both of its outputs are read while it runs.

    `within` is a command that runs it elsewhere, such as in another network namespace.
    """

    def __init__(self, module, *arguments, cwd, within=(), **variables):
        self.process = subprocess.Popen(
            [*within, sys.executable, "-m", "mmt.cli.entry", module, *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=cwd,
            env={**os.environ, **variables},
            start_new_session=True,
        )
        self._news = threading.Condition()
        self._texts = {"stdout": "", "stderr": ""}
        self._readers = [
            threading.Thread(target=self._read, args=(name, stream), daemon=True)
            for name, stream in (("stdout", self.process.stdout), ("stderr", self.process.stderr))
        ]
        for reader in self._readers:
            reader.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(LONGEST_S)
        for reader in self._readers:
            reader.join(LONGEST_S)

    @property
    def stdout(self) -> str:
        return self._texts["stdout"]

    @property
    def stderr(self) -> str:
        return self._texts["stderr"]

    def lines(self, kind):
        """The JSON lines of a kind so far."""
        whole = self.stdout[: self.stdout.rfind("\n") + 1].splitlines()
        parsed = [json.loads(line) for line in whole]
        return [line for line in parsed if line["kind"] == kind]

    def events(self):
        return [line["event"] for line in self.lines("event")]

    def summary(self):
        (line,) = self.lines("summary")
        return line

    def wait_for(self, happened, timeout_s=LONGEST_S):
        """Wait until something is true of what it printed."""
        with self._news:
            good = self._news.wait_for(
                lambda: happened() or not any(r.is_alive() for r in self._readers), timeout_s
            )
        assert good, f"timed out; {self.stdout=} {self.stderr=}"
        assert happened(), f"it ended before; {self.stdout=} {self.stderr=}"

    def port(self):
        """Wait until a leader with --json-lines listens, and return where."""
        self.wait_for(lambda: self.lines("ready"))
        return int(self.lines("ready")[0]["port"])

    def signal(self, number):
        """Send a signal, and return the moment."""
        self.process.send_signal(number)
        return time.monotonic()

    def end(self, timeout_s=LONGEST_S):
        """Wait for its end and return the exit code."""
        code = self.process.wait(timeout_s)
        for reader in self._readers:
            reader.join(timeout_s)
        return code

    def _read(self, name, stream):
        with stream:
            for line in stream:
                with self._news:
                    self._texts[name] += line
                    self._news.notify_all()
        with self._news:
            self._news.notify_all()


@contextmanager
def session(cwd, scene_name, *leader_arguments, follower_arguments=(), **variables):
    """A leader and a follower that have found each other, with JSON lines."""
    common = ("--json-lines", "--port", 0)
    with (
        Service(
            "leader", scene(scene_name), *common, *leader_arguments, cwd=cwd, **variables
        ) as leader,
        follower_of(leader, scene_name, cwd, *follower_arguments, **variables) as follower,
    ):
        leader.wait_for(lambda: any("follower connected" in e for e in leader.events()))
        yield leader, follower


def follower_of(leader, scene_name, cwd, *arguments, **variables):
    """A follower for a leader that listens."""
    return Service(
        "follower",
        scene(scene_name),
        "--json-lines",
        "--leader",
        f"http://127.0.0.1:{leader.port()}",
        *arguments,
        cwd=cwd,
        **variables,
    )


def streamed_s(leader):
    """Session time of a leader's newest status."""
    statuses = leader.lines("status")
    return float(statuses[-1]["time_s"]) if statuses else 0.0
