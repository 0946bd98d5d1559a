"""What a scene leaves out is not even imported."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec

import pytest
from frame_samples import made_frames
from service_processes import CONFIGS, LONGEST_S, Service

from mmt.scene.files import load_scene
from mmt.session.files import write_session

PROGRAM = """
import asyncio, importlib, json, os, pathlib, sys
service, runs = sys.argv[1], json.loads(sys.argv[2])
importlib.import_module(f"mmt.cli.{service}")
from mmt.scene.files import load_scene

async def main(scene, changes):
    module = importlib.import_module(f"mmt.{service}.service")
    name = service.capitalize()
    make = getattr(module, name, None) or getattr(module, f"{name}Service")
    running = make(load_scene(pathlib.Path(scene), changes))
    await running.run(running.stop)

def run(folder, scene, changes):
    os.chdir(folder)
    asyncio.run(main(scene, changes))
    pathlib.Path("modules.json").write_text(json.dumps(sorted(sys.modules)))

for each in runs:
    child = os.fork()
    if child == 0:
        run(*each)
        sys.stdout.flush()
        os._exit(0)
    os.waitpid(child, 0)
"""
"""Run a service in each scene, end it as soon as it is ready, and write what it has imported.

Each run is a child of a process that has imported the command line alone.
"""

SCENES = {
    "devices": """
[link]
[devices]
robot = "lean_driver:Device"
accelerometer = "lean_driver:Device"
[playout]
[actuator]
""",
    "published": """
[link]
[simulated]
[hand]
[texture]
method = "published"
[rendering]
[playout]
[actuator]
""",
    "passive": "[link]\n[simulated]\n[hand]\n[force_feedback]\nmethod = 'passive'",
    "model": "[link]\n[simulated]\n[hand]\n[force_feedback]\nmethod = 'model'",
}
"""Scenes beside the examples."""

DRIVER = """
class Device:
    def connect(self): pass
    def calibrate(self): pass
    def read(self): return (0.0, 0.0, 9.81)
    def write(self, position_mm): pass
    def close(self): pass
"""

NUMERICS = {"numba", "scipy", "mmt.core.compiled"}
NETWORK = {"mmt.link", "socketio", "aiohttp", "msgpack"}
FILES = {"mmt.session", "mcap", "google.protobuf", "zstandard"}
MODEL = {*NUMERICS, "mmt.leader.modelling.pipeline", "mmt.texture.synthesis.synthesizer"}
LEVEL = {"mmt.texture.field.posterior", "mmt.texture.completion.uncertainty"}
SHARING = {"mmt_share.messages"}
CONTROL = {"mmt_share.parts.control", "mmt_share.parts.operating", "mmt_share.control_messages"}
HAND = "mmt.testing.simulation.hand"
ACTUATOR = "mmt.testing.simulation.actuator"
RECORDER = "mmt.session.recorder"
SIMULATED, REPLAY, DEVICE_SOURCE = SOURCES = (
    "mmt.testing.simulation.follower",
    "mmt.session.replay",
    "mmt.devices.streaming.source",
)

MODELLING = {*NETWORK, *MODEL, ACTUATOR}
RECORDING = {*FILES, RECORDER}
RENDERING = MODEL - {"mmt.leader.modelling.pipeline"}
FORCES = {"mmt.follower.feedback", "mmt.contact.passivity"}
BY_MODEL = {"mmt.leader.motion.feedback_model", "mmt.contact.passivity", "mmt.contact.estimation"}
PASSIVE = {"mmt.leader.motion.feedback_passive", "mmt.contact.passivity"}
SIMULATED_SCENES = ("demo", "rough-texture", "anisotropic", "two-surfaces")

EXPECTED = {
    **{f"leader {name}": MODELLING | RECORDING | {HAND} for name in SIMULATED_SCENES},
    **{f"follower {name}": {*NETWORK, SIMULATED} for name in SIMULATED_SCENES},
    "leader published": MODELLING | {HAND},
    "follower published": {*NETWORK, SIMULATED},
    "leader virtual-lab": MODELLING | RECORDING | {HAND},
    "follower virtual-lab": {*NETWORK, DEVICE_SOURCE},
    "leader virtual-arm": MODELLING | RECORDING | {"mmt.contact.estimation"},
    "follower virtual-arm": {*NETWORK, DEVICE_SOURCE, *FORCES},
    "leader replay": MODELLING | RECORDING,
    "follower replay": {*NETWORK, *FILES, REPLAY},
    "leader stream-only": {*NETWORK, HAND, ACTUATOR},
    "follower stream-only": {*NETWORK, SIMULATED},
    "leader model-only": {*RENDERING, "mmt.texture.field.posterior", HAND, ACTUATOR},
    "leader passive": {*NETWORK, HAND, *PASSIVE},
    "follower passive": {*NETWORK, SIMULATED, *FORCES},
    "leader model": {*NETWORK, HAND, *BY_MODEL},
    "follower model": {*NETWORK, SIMULATED, *FORCES},
    "leader listener": {*NETWORK, *RENDERING, *SHARING, HAND, ACTUATOR},
    "leader operator": {*NETWORK, *RENDERING, *SHARING, *BY_MODEL, HAND, ACTUATOR}
    | (CONTROL - {"mmt_share.parts.control"}),
    "leader devices": {*NETWORK, ACTUATOR},
    "follower devices": {*NETWORK, DEVICE_SOURCE},
}
"""What each service imports of what is heavy or stands for a part, and nothing else of it.

A new example scene needs its lines here, and a new part its module.
"""

LACKING = set() if find_spec("rtde_control") else {"virtual-arm"}
"""Scenes whose extra has no wheel for every system."""

WATCHED = {*MODELLING, *RECORDING, *SOURCES, *FORCES, *BY_MODEL, *LEVEL, *SHARING, *CONTROL}
WATCHED |= {HAND, *PASSIVE}
NEVER = {
    "mmt.leader.monitoring",
    "mmt.web.monitor",
    "mmt.web.page_server",
    "prometheus_client",
    "pylsl",
    "rclpy",
    "rosbags",
    "mmt.core.output.exposition",
    "matplotlib",
    "scipy.signal",
    "mmt.evaluation",
    "mmt.texture.online.modeller",  # is for the process that models, as are
    "mmt.texture.segmentation",
    "mmt.texture.surfaces",
    "h5py",
    "pyarrow",
    "tomli_w",
    "mmt.link.emulated.network",  # without the table no network is emulated
    "mmt.link.emulated.impairments",
}


def with_drivers(directory):
    """The variable that lets a service import from the folder."""
    paths = [str(directory), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {"PYTHONPATH": os.pathsep.join(paths)}


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """A folder with a recording, a driver, and a scene that names the driver."""
    directory = tmp_path_factory.mktemp("lean")
    write_session(directory / "made.mcap", made_frames(0, 100))
    (directory / "lean_driver.py").write_text(DRIVER)
    for name, text in SCENES.items():
        (directory / f"{name}.toml").write_text(text)
    return directory


@pytest.fixture(scope="module")
def modules(directory):
    """The modules of each service in each example scene, by e.g. "leader demo"."""
    scenes = {path.stem: path for path in sorted(CONFIGS.glob("*.toml"))}
    hardware = {name for name in scenes if name.endswith(("-leader", "-follower"))}
    for name in LACKING | hardware:
        del scenes[name]
    scenes |= {name: directory / f"{name}.toml" for name in SCENES}
    loaded = {name: load_scene(path) for name, path in scenes.items()}
    runs = [
        (service, name)
        for name, scene in loaded.items()
        for service in ("leader", "follower")
        if service == "leader" or scene.source is not None
    ]

    def prepared(service, name):
        own = directory / f"{service}-{name}"  # two scenes may record into the same file
        own.mkdir()
        changes = {}
        if loaded[name].link is not None:
            changes["link.port"] = {"leader": 0, "follower": 1}[service]
        if loaded[name].replay is not None:
            changes["replay.file"] = str(directory / "made.mcap")
        return str(own), str(scenes[name]), changes

    def run(service):
        own = [prepared(*each) for each in runs if each[0] == service]
        return subprocess.run(
            [sys.executable, "-c", PROGRAM, service, json.dumps(own)],
            check=False,
            capture_output=True,
            text=True,
            timeout=4 * LONGEST_S,
            env={**os.environ, **with_drivers(directory), "MMT_CONTROL_TOKEN": "f" * 32},
        )

    with ThreadPoolExecutor(max_workers=2) as pool:
        ended = list(pool.map(run, ("leader", "follower")))
    found = {each: directory / "-".join(each) / "modules.json" for each in runs}
    errors = "".join(process.stderr for process in ended)
    assert [each for each, file in found.items() if not file.exists()] == [], errors
    return {" ".join(each): set(json.loads(file.read_text())) for each, file in found.items()}


def among(modules, names):
    """Which of the packages or modules are there, themselves or in part."""
    present = set(modules)
    return {name for name in names if any(m == name or m.startswith(f"{name}.") for m in present)}


def test_every_example_scene_has_an_expectation(modules):
    lacking = {f"{side} {name}" for name in LACKING for side in ("leader", "follower")}
    assert set(modules) | lacking == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_service_imports_what_its_scene_needs_and_no_more(modules, name):
    if name.split()[1] in LACKING:
        pytest.skip("ur-rtde is not installed")
    assert among(modules[name], WATCHED) == EXPECTED[name]
    other = {"leader": "mmt.follower", "follower": "mmt.leader"}[name.split()[0]]
    assert among(modules[name], {*NEVER, other}) == set()


def test_devices_stream_to_a_leader_without_numerics_on_either_side(directory):
    """Not only at the start: the services say what they have imported after they streamed."""
    scene, common = directory / "devices.toml", ("--json-lines",)
    arguments = (scene, *common, "--port", 0, "--duration", 1)
    with Service("leader", *arguments, cwd=directory) as leader:
        url = f"http://127.0.0.1:{leader.port()}"
        with Service(
            "follower", scene, *common, "--leader", url, cwd=directory, **with_drivers(directory)
        ) as follower:
            assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
    assert leader.summary()["link"]["frames"] > 100, "a missed tick is a missing frame"
    assert leader.summary()["vibration"]["actuator"]["samples"] > 0
    for service in (leader, follower):
        (found,) = service.lines("modules")
        assert among(found["modules"], {"mmt.link", *NUMERICS}) == {"mmt.link"}
