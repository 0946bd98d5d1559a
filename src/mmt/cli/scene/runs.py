"""Run scenes as processes, to measure them."""

import asyncio
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from mmt.cli.running.scene_services import DemoRun, run_services
from mmt.cli.scene.costs import OF_PROCESSES, SceneRun
from mmt.core.errors import MmtError
from mmt.scene import Replay, Scene
from mmt.scene.table import added_parts

_MARGIN_S = 2.0
"""Extra length of a recording that is simulated for a replay."""
_MOMENT = {"duration_s": 0.2}


class SceneRunner:
    """Runs scenes for a given duration, with their recordings in one directory.

    Parameters
    ----------
    directory
        Directory for the recordings.
    duration_s
        Duration of a run.
    """

    def __init__(self, directory: Path, duration_s: float) -> None:
        self._directory = directory
        self._recorded = directory / "recorded.mcap"
        self._duration_s = duration_s
        needed = {name for part in added_parts().values() for name in part.secrets}
        unused = {name: secrets.token_hex(32) for name in needed}  # never used to connect
        self._environment = {**unused, **os.environ}

    def prepare(self, scene: Scene) -> Scene:
        """Return the scene to run, with duration, recording and replay set."""
        changes: dict[str, Any] = {
            "session": scene.session.model_copy(update={"duration_s": self._duration_s})
        }
        if scene.recording is not None:
            changes["recording"] = scene.recording.model_copy(update={"file": self._recorded})
        if scene.replay is not None and scene.replay.file is None:
            changes["replay"] = scene.replay.model_copy(update={"file": self._simulate(scene)})
        return scene.model_copy(update=changes)

    def _simulate(self, scene: Scene) -> Path:
        from mmt.session.files import write_session
        from mmt.testing.simulation.offline import simulate_session

        file = self._directory / "simulated.mcap"
        speed = (scene.replay or Replay()).speed
        frames, annotations = simulate_session(
            Scene(), duration_s=(self._duration_s + _MARGIN_S) * max(1.0, speed)
        )
        write_session(file, frames, annotations=annotations)
        return file

    def warm_up(self, scene: Scene) -> None:
        """Run a scene briefly, so that compiling at the first start is not measured."""
        self(scene.model_copy(update={"session": scene.session.model_copy(update=_MOMENT)}))

    def __call__(self, scene: Scene) -> SceneRun:
        """Run a prepared scene, whole or in part, once.

        Raises
        ------
        MmtError
            A service failed.
        KeyboardInterrupt
            The run was interrupted; both services have ended.
        """
        quiet = Console(quiet=True)
        run = asyncio.run(run_services(scene, console=quiet, environment=self._environment))
        self._recorded.unlink(missing_ok=True)
        if run.interrupted:
            raise KeyboardInterrupt
        if run.failed:
            raise MmtError("; ".join(run.errors))
        return _scene_run(run)


def _scene_run(run: DemoRun) -> SceneRun:
    streamed_s = max(float(run.leader["session"]["duration_s"]), 1e-3)
    senders = {"up": run.follower.get("link"), "down": run.leader.get("link")}
    sent = {way: link["bytes_sent"] for way, link in senders.items() if link}
    return SceneRun(
        {name: _figures(table, run.start_s[name]) for name, table in run.tables().items()},
        {name: frozenset(modules) for name, modules in run.modules.items()},
        {way: count / streamed_s for way, count in sent.items()},
        _model_from_s(run.leader.get("vibration", {})),
    )


def _figures(summary: Mapping[str, Any], start_s: float) -> dict[str, float]:
    """Return the figures of a service, with those of the leader's second process."""
    process, modelling = summary["process"], (summary.get("texture") or {}).get("process") or {}
    added = {name: process[name] + modelling.get(name, 0.0) for name in OF_PROCESSES}
    return {"start_s": start_s, **added}


def _model_from_s(vibration: Mapping[str, Any]) -> float | None:
    """Return when the model began to drive the vibration: 0 if from the start, None if never."""
    for switch in vibration.get("switches", []):
        if switch["mode"] == "synthesized":
            return float(switch["time_s"])
    return 0.0 if vibration.get("mode") == "synthesized" else None
