"""The demo's services as processes, for the experiments that measure them."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mmt.cli.scene_services import DemoRun, run_services
from mmt.core.errors import MmtError
from mmt.scene.files import example_scenes, load_scene


async def run_demo_services(
    duration_s: float,
    scene_name: str = "demo",
    *,
    realtime: bool = False,
    environment: Mapping[str, str] | None = None,
    on_link: Callable[[str], None] = lambda _: None,
) -> DemoRun:
    """Run the services of an example scene, which record to a temporary file.

    Parameters
    ----------
    duration_s
        How long the session lasts.
    scene_name
        Name of the scene.
    realtime, environment, on_link
        See `mmt.cli.scene_services.run_services`.

    Raises
    ------
    MmtError
        A service failed.
    """
    scene_file = example_scenes()[scene_name]
    with tempfile.TemporaryDirectory() as directory:
        overrides: dict[str, Any] = {
            "session.duration_s": duration_s,
            "recording.file": str(Path(directory) / "session.mcap"),
        }
        scene = load_scene(scene_file, overrides)
        run = await run_services(
            scene_file,
            scene,
            duration_s,
            None,
            environment=environment,
            realtime=realtime,
            on_link=on_link,
        )
    if run.failed:
        raise MmtError("the services did not end well: " + "; ".join(run.errors))
    return run
