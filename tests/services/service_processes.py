"""The services as processes, as a person or a program starts them."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Self

CONFIGS = Path(__file__).parents[2] / "configs"
LONGEST_S = 60.0
"""No wait in these tests lasts longer; a first start compiles the numerics beforehand."""


def scene(name: str) -> str:
    """The path of an example scene."""
    return str(CONFIGS / f"{name}.toml")


class Service:
    """A command of mmt as a process; both of its outputs are read while it runs.

    `within` is a command that runs it elsewhere, such as in another network namespace.
    """

    def __init__(
        self,
        module: str,
        *arguments: object,
        cwd: Path,
        within: Sequence[str] = (),
        **variables: str,
    ) -> None:
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
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

    def lines(self, kind: str) -> list[dict[str, Any]]:
        """The JSON lines of a kind so far."""
        whole = self.stdout[: self.stdout.rfind("\n") + 1].splitlines()
        parsed = [json.loads(line) for line in whole]
        return [line for line in parsed if line["kind"] == kind]

    def events(self) -> list[str]:
        return [line["event"] for line in self.lines("event")]

    def summary(self) -> dict[str, Any]:
        (line,) = self.lines("summary")
        return line

    def wait_for(self, happened: Callable[[], object], timeout_s: float = LONGEST_S) -> None:
        """Wait until something is true of what it printed."""
        with self._news:
            good = self._news.wait_for(
                lambda: happened() or not any(r.is_alive() for r in self._readers), timeout_s
            )
        assert good, f"timed out; {self.stdout=} {self.stderr=}"
        assert happened(), f"it ended before; {self.stdout=} {self.stderr=}"

    def port(self) -> int:
        """Wait until a leader with --json-lines listens, and return where."""
        self.wait_for(lambda: self.lines("ready"))
        return int(self.lines("ready")[0]["port"])

    def signal(self, number: signal.Signals) -> float:
        """Send a signal, and return the moment."""
        self.process.send_signal(number)
        return time.monotonic()

    def end(self, timeout_s: float = LONGEST_S) -> int:
        """Wait for its end and return the exit code."""
        code = self.process.wait(timeout_s)
        for reader in self._readers:
            reader.join(timeout_s)
        return code

    def _read(self, name: str, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                with self._news:
                    self._texts[name] += line
                    self._news.notify_all()
        with self._news:
            self._news.notify_all()


@contextmanager
def session(
    cwd: Path,
    scene_name: str,
    *leader_arguments: object,
    follower_arguments: tuple[object, ...] = (),
    **variables: str,
) -> Iterator[tuple[Service, Service]]:
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


def follower_of(
    leader: Service, scene_name: str, cwd: Path, *arguments: object, **variables: str
) -> Service:
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


def streamed_s(leader: Service) -> float:
    """Session time of a leader's newest status."""
    statuses = leader.lines("status")
    return float(statuses[-1]["time_s"]) if statuses else 0.0
