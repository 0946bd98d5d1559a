"""``mmt scene explain``: what it prints, what it refuses, and one run of real services."""

import asyncio
import json
import os
import signal
import sys

import pytest
import tomli_w
from command_runs import output_of
from rich.console import Console
from service_processes import Service

from mmt.cli.running import scene_services
from mmt.cli.running.scene_services import DemoRun
from mmt.cli.scene import runs as scene_runs
from mmt.cli.scene.costs import SceneRun
from mmt.cli.scene.runs import SceneRunner
from mmt.core.errors import MmtError
from mmt.core.output.streams import is_queued
from mmt.scene.files import example_scenes, load_scene
from mmt.session.files import read_session

DEVICES = '[link]\n[devices]\nrobot = "lab:Robot"\naccelerometer = "lab:A"\n[playout]\n[actuator]\n'


@pytest.fixture
def explain(monkeypatch):
    """Run the command in this process, 80 columns wide, on services that are made up."""
    monkeypatch.setattr("mmt.cli.common.output.width", 80)

    def made(runner, scene):
        modules = {"numpy", "scipy"} if scene.texture is not None else {"numpy"}
        figures = {"start_s": 1.5, "core_share": 0.3, "memory_mb": 90.0 + len(modules)}
        sides = ("leader", "follower") if scene.source else ("leader",)
        holds = dict.fromkeys(sides, frozenset(modules))
        return SceneRun(dict.fromkeys(sides, figures), holds, {"up": 71_300.0, "down": 0.0}, None)

    monkeypatch.setattr(SceneRunner, "__call__", made)
    return lambda *arguments: output_of("scene", "explain", *arguments)


def test_without_measuring_it_says_parts_channels_and_bytes(explain):
    said = explain("demo", "--no-measure")
    for word in ("recording", "devices", "frames: position", "76.0", "70.0"):
        assert word in said
    assert "memory" not in said


@pytest.mark.parametrize("name", example_scenes())
def test_measured_it_fits_80_columns_and_cuts_nothing(name, explain):
    said = explain(name, "--devices")  # the examples move none
    assert max(map(len, said.splitlines())) <= 80
    assert "…" not in said
    for word in ("1.50 (1.50 to 1.50)", "modules", "numpy"):
        assert word in said
    assert ("kB/s" in said) == (name not in {"model-only", "listener", "operator"})


def test_a_part_that_costs_is_told_from_those_that_do_not(explain):
    said = explain("demo").partition("What a part costs the leader")[2]
    rows = {line.split()[0]: line for line in said.splitlines() if "±" in line}
    assert "≈0 ±0.00" in rows["recording"]
    assert rows["texture"].split("±")[2].split()[-1] == "1.0", "texture holds a module"
    assert "What a part costs the follower" not in said, "no part changes what it sends"
    sent = explain("stream-only").partition("What a part costs the follower")[2]
    assert "force_feedback" in sent
    assert "12.0" in sent


def test_the_json_holds_what_was_printed(explain, tmp_path):
    explain("demo", "--no-parts", "--json", tmp_path / "it.json")
    content = json.loads((tmp_path / "it.json").read_text())
    assert content["scene"] == "demo"
    assert {"texture", "recording"} <= set(content["leader"]["runs"])
    assert "devices" in content["follower"]["left_out"]
    assert content["streams"][0]["bytes_per_s"] == 76_000.0
    assert content["measured"]["services"]["leader"]["packages"] == ["numpy", "scipy"]
    assert content["measured"]["parts"] == {}
    assert content["measured"]["machine"]["processor"]


def test_devices_move_only_when_asked(explain, tmp_path):
    scene = tmp_path / "lab.toml"
    scene.write_text(DEVICES)
    said = explain(scene)
    assert "--devices measures it" in said.replace("\n", " ")
    assert "start (s)" not in said
    assert "start (s)" in explain(scene, "--devices")


def test_a_run_writes_nowhere_but_in_its_directory_and_replays_what_was_named(tmp_path):
    runner = SceneRunner(tmp_path, 2.0)
    named = load_scene(example_scenes()["replay"], replay=tmp_path / "mine.mcap")
    assert runner.prepare(named).replay == named.replay
    prepared = runner.prepare(load_scene("replay"))
    assert prepared.session.duration_s == 2.0
    assert prepared.recording.file.parent == tmp_path
    assert prepared.replay.file is not None
    assert len(read_session(prepared.replay.file).frames) >= 3000, "longer than the run"


@pytest.mark.parametrize(
    ("outcome", "error"),
    [
        (DemoRun(interrupted=True, failed=True), KeyboardInterrupt),
        (DemoRun(failed=True, errors=["leader ended", "no port"]), MmtError),
    ],
)
def test_a_run_that_does_not_end_well_is_no_measurement(outcome, error, tmp_path, monkeypatch):
    async def run_services(*_, **__):
        return outcome

    monkeypatch.setattr(scene_runs, "run_services", run_services)
    with pytest.raises(error):
        SceneRunner(tmp_path, 2.0)(load_scene("stream-only"))


@pytest.mark.parametrize("modelling", [None, {"core_share": 0.25, "memory_mb": 180.0}])
def test_a_leaders_cost_is_with_that_of_the_process_that_models(modelling, tmp_path, monkeypatch):
    leader = {
        "session": {"duration_s": 2.0},
        "process": {"core_share": 0.5, "memory_mb": 100.0},
        "texture": {"process": modelling},
    }

    async def run_services(*_, **__):
        return DemoRun(leader, start_s={"leader": 1.0}, modules={"leader": []})

    monkeypatch.setattr(scene_runs, "run_services", run_services)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recorded.mcap").touch()
    demo = load_scene("demo")
    demo.recording.file.parent.mkdir()
    demo.recording.file.touch()
    found = SceneRunner(tmp_path, 2.0)(demo).figures["leader"]
    assert demo.recording.file.exists(), "a recording of the user is none of the run"
    assert not (tmp_path / "recorded.mcap").exists()
    cost = found["core_share"], found["memory_mb"]
    assert cost == ((0.75, 280.0) if modelling else (0.5, 100.0))


class EndedChild:
    """A service that has been ready, and has ended."""

    age_s, messages = 0.5, ""

    def __init__(self, name):
        self.name = name

    async def lines(self):
        yield {"kind": "ready", "port": 8765}
        yield {"kind": "event", "event": "shared"}

    async def wait(self):
        return 0

    async def kill(self):
        """It has ended."""

    def interrupt(self):
        """It has ended."""


@pytest.mark.parametrize("shows_monitor", [True, False])
async def test_a_monitor_is_opened_for_a_person_alone(shows_monitor, monkeypatch):
    async def start(name, _module, arguments, environment, _on_warning):
        assert "MMT_TEXTURE__ORDER" not in environment, "it would bring [texture] back"
        assert environment["PATH"] == os.environ["PATH"]
        assert load_scene(arguments[1]) == scene
        return EndedChild(name)

    opened = []
    monkeypatch.setenv("MMT_TEXTURE__ORDER", "8")
    monkeypatch.setattr(scene_services.Child, "start", start)
    monkeypatch.setattr(scene_services, "open_page", opened.append)
    scene = load_scene("demo", tables=["monitor"])
    shown = {"shows_monitor": True} if shows_monitor else {}
    state = signal.getsignal(signal.SIGINT), sys.stdout, sys.stderr, is_queued()
    run = await scene_services.run_services(scene, console=Console(quiet=True), **shown)
    assert not run.failed
    assert len(opened) == shows_monitor
    assert state == (signal.getsignal(signal.SIGINT), sys.stdout, sys.stderr, is_queued())


class SlowSideService:
    """A side service that is up some time after the session has ended."""

    def __init__(self, start_s):
        self.start_s, self.started = start_s, False

    def start_on_event(self, sentence):
        return self.start() if sentence == "shared" else None

    async def start(self):
        await asyncio.sleep(self.start_s)
        self.started = True
        return "up"


@pytest.mark.parametrize(("start_s", "interrupted"), [(6.0, False), (3600.0, True)])
async def test_a_side_service_is_waited_for_until_an_interrupt(start_s, interrupted, monkeypatch):
    async def start(name, *_):
        return EndedChild(name)

    monkeypatch.setattr(scene_services.Child, "start", start)
    service = SlowSideService(start_s)
    if interrupted:
        asyncio.get_running_loop().call_later(0.5, os.kill, os.getpid(), signal.SIGINT)
    scene = load_scene("demo")
    async with asyncio.timeout(25):
        run = await scene_services.run_services(
            scene, console=Console(quiet=True), side_services=[service]
        )
    assert (service.started, run.interrupted) == (not interrupted, interrupted)


def test_real_services_tell_what_they_run_and_cost(tmp_path):
    scene = tmp_path / "small.toml"
    tables = {**load_scene("stream-only").dump(), "recording": {"file": "never.mcap"}}
    scene.write_text(tomli_w.dumps(tables))
    arguments = ["--duration", "1", "--no-parts", "--json", "it.json"]
    with Service("main", "scene", "explain", scene, *arguments, cwd=tmp_path) as explaining:
        assert explaining.end() == 0, explaining.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"small.toml", "it.json"}
    measured = json.loads((tmp_path / "it.json").read_text())["measured"]
    leader, follower = measured["services"]["leader"], measured["services"]["follower"]
    for service in (leader, follower):
        assert service["start_s"]["least"] > 0.05
        assert 0.0 < service["core_share"]["mean"] < 2.0
        assert 20 < service["memory_mb"]["mean"] < 1000
        held = {"numba", "scipy", "mcap"} & set(service["packages"])
        assert held == ({"mcap"} if service is leader else set())
    assert 10_000 < measured["bytes_per_s"]["up"] < 78_000
