"""What a scene leaves out is not even imported."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import pytest
from service_processes import CONFIGS, LONGEST_S
from service_runs import made_frames

from mmt.session import write_session

PROGRAM = """
import asyncio, importlib, json, pathlib, sys
service, scene, changes = sys.argv[1], pathlib.Path(sys.argv[2]), json.loads(sys.argv[3])
importlib.import_module(f"mmt.cli.{service}")
from mmt.scene_files import load_scene

async def main():
    module = importlib.import_module(f"mmt.{service}.service")
    make = getattr(module, f"{service.capitalize()}Service")
    running = make(load_scene(scene, changes))
    await running.run(running.stop)

asyncio.run(main())
print(json.dumps(sorted(sys.modules)))
"""
"""Run a service, end it as soon as it is ready, and print what it has imported."""

DEVICES = """
[link]
[devices]
robot = "lean_driver:Robot"
accelerometer = "lean_driver:Robot"
[playout]
[actuator]
"""

DRIVER = """
class Robot:
    def close(self):
        pass
"""

NUMERICS = {"numba", "scipy", "mmt.compiled"}
NEVER = {"matplotlib", "scipy.signal", "mmt.evaluation", "h5py", "pyarrow"}


@pytest.fixture(scope="module")
def modules(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """The modules of each service in each example scene, by e.g. "leader demo"."""
    directory = tmp_path_factory.mktemp("lean")
    write_session(directory / "made.mcap", made_frames(0, 100))
    (directory / "devices.toml").write_text(DEVICES)
    (directory / "lean_driver.py").write_text(DRIVER)
    scenes = {path.stem: path for path in sorted(CONFIGS.glob("*.toml"))}
    scenes["devices"] = directory / "devices.toml"
    runs = [
        (service, name)
        for name in scenes
        for service in ("leader", "follower")
        if (service, name) != ("follower", "model-only")
    ]

    def run(service_and_name: tuple[str, str]) -> subprocess.CompletedProcess[str]:
        service, name = service_and_name
        port = {"leader": 0, "follower": 1}[service]
        changes: dict[str, object] = {} if name == "model-only" else {"link.port": port}
        if name == "replay":
            changes["replay.file"] = "made.mcap"
        return subprocess.run(
            [sys.executable, "-c", PROGRAM, service, scenes[name], json.dumps(changes)],
            check=False,
            capture_output=True,
            text=True,
            cwd=directory,
            timeout=LONGEST_S,
            env={**os.environ, "PYTHONPATH": str(directory)},
        )

    with ThreadPoolExecutor(max_workers=2) as pool:
        ended = dict(zip(map(" ".join, runs), pool.map(run, runs), strict=True))
    assert {name: process.stderr for name, process in ended.items() if process.returncode} == {}
    return {name: set(json.loads(process.stdout)) for name, process in ended.items()}


def among(modules: Iterable[str], names: Iterable[str]) -> set[str]:
    """Which of the packages or modules are there, themselves or in part."""
    present = set(modules)
    return {name for name in names if any(m == name or m.startswith(f"{name}.") for m in present)}


def test_every_example_scene_is_looked_at(modules: dict[str, set[str]]) -> None:
    assert {"leader demo", "leader model-only", "follower replay"} <= set(modules)


def test_no_service_imports_what_is_for_offline_work(modules: dict[str, set[str]]) -> None:
    assert {name: among(found, NEVER) for name, found in modules.items()} == {
        name: set() for name in modules
    }


@pytest.mark.parametrize("name", ["demo", "replay", "stream-only", "devices"])
def test_a_follower_needs_no_numerics_and_no_leader(
    modules: dict[str, set[str]], name: str
) -> None:
    assert among(modules[f"follower {name}"], {*NUMERICS, "mmt.leader"}) == set()
    assert among(modules[f"leader {name}"], {"mmt.follower"}) == set()


def test_a_leader_that_only_streams_needs_no_numerics_and_no_recorder(
    modules: dict[str, set[str]],
) -> None:
    found = modules["leader stream-only"]
    assert among(found, {*NUMERICS, "mmt.session", "mcap", "google.protobuf"}) == set()
    assert among(found, {"mmt.link", "mmt.devices.simulated.hand"}) == {
        "mmt.link",
        "mmt.devices.simulated.hand",
    }


def test_a_leader_without_a_link_has_no_network(modules: dict[str, set[str]]) -> None:
    found = modules["leader model-only"]
    lean = {"mmt.link", "socketio", "engineio", "aiohttp", "msgpack", "mmt.session", "mcap"}
    assert among(found, {*lean, "mmt.texture.modelling", "mmt.texture.filtering"}) == set()
    assert among(found, {"mmt.texture.synthesis", "numba"}) == {"mmt.texture.synthesis", "numba"}


def test_a_leader_of_a_replay_has_no_hand(modules: dict[str, set[str]]) -> None:
    assert among(modules["leader replay"], {"mmt.devices.simulated.hand"}) == set()
    assert among(modules["leader replay"], {"mmt.texture.modelling", "mmt.session.recording"}) == {
        "mmt.texture.modelling",
        "mmt.session.recording",
    }


def test_without_the_table_no_network_is_emulated(modules: dict[str, set[str]]) -> None:
    emulation = {"mmt.link.emulation", "mmt.link.network", "mmt.link.impairments"}
    assert all(among(found, emulation) == set() for found in modules.values())


def test_a_follower_has_its_own_source_alone(modules: dict[str, set[str]]) -> None:
    sources = {"mmt.devices.simulated.follower", "mmt.session.replay", "mmt.devices.source"}
    assert among(modules["follower demo"], sources) == {"mmt.devices.simulated.follower"}
    assert among(modules["follower replay"], sources) == {"mmt.session.replay"}
    assert among(modules["follower devices"], sources) == {"mmt.devices.source"}
    assert among(modules["follower demo"], {"mmt.session", "mcap"}) == set()
