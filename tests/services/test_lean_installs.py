"""A machine installs what it runs; what is missing is said with the command that installs it."""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from python_programs import run_mmt
from service_processes import Service, scene

from mmt import Scene, simulate_session, write_session
from mmt.core.extras import PACKAGES

ROOT = Path(__file__).parents[2]
OWN = {each.name for each in (ROOT / "src").iterdir() if each.is_dir()}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]

ABSENT = """
import os, sys
for name in os.environ["MMT_TEST_ABSENT"].split():
    sys.modules[name] = None
"""
"""With `None` for a module, it is found nowhere and its import fails."""


def without(directory, *packages):
    """The variables with which Python does not find these packages."""
    (directory / "sitecustomize.py").write_text(ABSENT)
    return {"PYTHONPATH": str(directory), "MMT_TEST_ABSENT": " ".join(packages)}


NOT_IN_ALL = {"rtde_control": ["ur-rtde"], "rtde_receive": ["ur-rtde"]}
"""Import name -> distributions of what may not be installed where the tests run."""


BROUGHT = {("lerobot", "lerobot"), ("rclpy", "ros")}
"""Packages that no extra installs, and the module or folder that is run where they are there:
LeRobot imports its plug-in itself, and rclpy comes with ROS."""


def named(requirements):
    """The distributions of a list of requirements."""
    return {re.split(r"[\[>=]", one)[0].replace("-", "_") for one in requirements}


def test_every_import_of_a_package_is_of_the_base_or_of_the_extra_that_is_named():
    distributions = packages_distributions()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                names = [node.module]
            for top in {name.partition(".")[0] for name in names}:
                if top in sys.stdlib_module_names or top in OWN:
                    continue
                if (top, path.stem) in BROUGHT or (top, path.parent.name) in BROUGHT:
                    continue
                extra = PACKAGES.get(top, ("", ""))[0]
                allowed = named(EXTRAS[extra] if extra else PROJECT["dependencies"])
                holders = distributions.get(top, NOT_IN_ALL.get(top, [top]))
                found = {each.replace("-", "_") for each in holders}
                assert allowed & found, f"{path}: {top} is not declared"


def test_all_holds_every_extra_but_those_for_developers_and_one_without_wheels():
    (everything,) = EXTRAS["all"]
    listed = re.fullmatch(r"mmt-haptics\[(.*)\]", everything)
    assert set(listed[1].split(",")) == set(EXTRAS) - {"all", "bench", "dev", "docs", "test", "ur"}


@pytest.mark.parametrize(
    "command",
    [
        ("main", "--help"),
        ("main", "lab"),
        ("main", "device", "list"),
        ("main", "scene", "explain", "--no-measure", "demo"),
        ("leader", "--help"),
    ],
    ids=" ".join,
)
def test_the_base_shows_help_scenes_and_devices(tmp_path, command):
    ended = run_mmt(tmp_path, *command, **without(tmp_path, *PACKAGES))
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        (("main", "demo"), "leader"),
        (("main", "demo", "stream-only"), "report"),
        (("main", "evaluate", "a.mcap"), "leader"),
        (("main", "model", "info", "oak"), "leader"),
        (("main", "scene", "explain", "demo"), "leader"),
        (("main", "session", "info", "a.mcap"), "recording"),
        (("main", "lab", "burg"), "leader"),
        (("main", "device", "test", "labjack-u6"), "devices"),
        (("main", "device", "test", "virtual-ur"), "ur"),
        (("main", "hub", "http://127.0.0.1:9"), "hub"),
        (("leader", "demo"), "leader"),
        (("leader", "stream-only", "--record", "a.mcap"), "recording"),
        (("leader", "stream-only", "--record", "a.mcap", "--report", "a"), "report"),
        (("follower", "replay", "--replay", "a.mcap"), "recording"),
    ],
    ids=str,
)
def test_what_an_extra_lacks_is_one_sentence_with_the_command(tmp_path, command, extra):
    (tmp_path / "a.mcap").touch()
    if "--record" in command:
        (tmp_path / "a.mcap").unlink()
    ended = run_mmt(tmp_path, *command, **without(tmp_path, *PACKAGES))
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr
    (error,) = [line for line in ended.stderr.splitlines() if line.startswith("error: ")]
    assert re.search(rf"which is not installed; install it with: .* -m pip .*\[{extra}\]", error)


def test_a_follower_on_devices_runs_without_the_leaders_packages(tmp_path):
    others = [name for name, (extra, _) in PACKAGES.items() if extra != "devices"]
    arguments = (scene("virtual-lab"), "--json-lines")
    with Service("leader", *arguments, "--port", 0, "--duration", 1, cwd=tmp_path) as leader:
        url = f"http://127.0.0.1:{leader.port()}"
        folder = tmp_path / "follower"
        folder.mkdir()
        absent = without(folder, *others)
        with Service("follower", *arguments, "--leader", url, cwd=folder, **absent) as follower:
            assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
    assert follower.summary()["link"]["frames"] > 100


INSTALLS = re.compile(r'^pip install -e "\.\[([\w,]+)\]"', re.MULTILINE)
COMMANDS = re.compile(r"^(?:(MMT_\w+)=(\S+) )?(mmt[\w-]*) (.*?)(?: +#.*)?$", re.MULTILINE)
RECIPES = {
    path.name: "".join(
        re.findall(r"^```sh\n(.*?)^```$", path.read_text(), re.MULTILINE | re.DOTALL)
    )
    for path in (ROOT / "docs" / "how-to").glob("*.md")
}
"""By the page: what it lets a person type."""
STARTED_S = 20.0
"""What lacks is said at the start."""


def brought_by(extras):
    """The distributions that extras bring, with those of the extras that are in them."""
    requirements = [one for extra in extras.split(",") for one in EXTRAS[extra]]
    inner = re.findall(r"mmt-haptics\[([\w,]+)\]", str(requirements))
    return named(requirements).union(*map(brought_by, inner))


@pytest.mark.parametrize("page", sorted(p for p, text in RECIPES.items() if INSTALLS.search(text)))
def test_a_page_installs_what_its_commands_need(page, tmp_path):
    there = brought_by(",".join(INSTALLS.findall(RECIPES[page])))
    holders = NOT_IN_ALL | packages_distributions()
    absent = [n for n in PACKAGES if not there & {d.replace("-", "_") for d in holders[n]}]
    frames, _ = simulate_session(Scene(), duration_s=2.0)
    for name in ("session", "one", "two", "a", "b"):
        write_session(tmp_path / f"{name}.mcap", frames)
    shutil.copy(ROOT / "configs" / "demo.toml", tmp_path / "SCENE")
    for variable, value, program, rest in COMMANDS.findall(RECIPES[page]):
        module, name = PROJECT["scripts"][program].split(":")
        arguments = shlex.split(rest) + (["--duration", "1"] if rest == "demo" else [])
        with subprocess.Popen(
            [sys.executable, "-c", f"from {module} import {name}; {name}()", *arguments],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            cwd=tmp_path,
            env=os.environ | without(tmp_path, *absent) | ({variable: value} if variable else {}),
        ) as started:
            try:
                _, said = started.communicate(timeout=STARTED_S)
            except subprocess.TimeoutExpired:
                started.terminate()
                _, said = started.communicate(timeout=STARTED_S)
        assert "which is not installed" not in said, f"{program} {rest}: {said}"
