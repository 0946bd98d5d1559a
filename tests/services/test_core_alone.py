"""The core without its plug-ins, as a distribution that has none: it runs what it promises."""

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from service_processes import LONGEST_S

ROOT = Path(__file__).parents[2]
OTHERS = sorted(
    each.name for each in (ROOT / "src").glob("mmt_*") if (each / "__init__.py").exists()
)

HIDDEN = """
import sys
for name in {others!r}:
    sys.modules[name] = None
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """A folder with the core and the entry points that it offers itself."""
    folder = tmp_path_factory.mktemp("core")
    shutil.copytree(ROOT / "src" / "mmt", folder / "mmt")
    shutil.copytree(ROOT / "configs", folder / "mmt" / "configs")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    distribution = folder / "mmt_haptics-0.dist-info"
    distribution.mkdir()
    (distribution / "METADATA").write_text("Metadata-Version: 2.1\nName: mmt-haptics\nVersion: 0\n")
    groups = {"console_scripts": project["scripts"], **project["entry-points"]}
    lines = []
    for group, entries in groups.items():
        own = (f"{name} = {home}" for name, home in entries.items() if home.startswith("mmt."))
        lines += [f"[{group}]", *own]
    (distribution / "entry_points.txt").write_text("\n".join(lines))
    (folder / "sitecustomize.py").write_text(HIDDEN.format(others=OTHERS))
    return folder


def run(core, directory, *arguments):
    ended = subprocess.run(
        [sys.executable, "-m", "mmt.cli.entry", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=directory,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(core), "HOME": str(directory)},
        timeout=4 * LONGEST_S,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_a_demo_runs_and_its_recording_is_looked_at_and_evaluated(core, tmp_path):
    run(core, tmp_path, "main", "demo", "--duration", "6")
    recording = next(tmp_path.rglob("*.mcap"))
    told = json.loads(run(core, tmp_path, "main", "session", "info", str(recording), "--json", "-"))
    assert told["complete"]
    assert told["frames"] > 5000
    assert "wood" in run(core, tmp_path, "main", "evaluate", str(recording))
    run(core, tmp_path, "main", "session", "export", str(recording), "out.npz")


def test_what_a_plug_in_brings_is_not_there(core, tmp_path):
    drivers = run(core, tmp_path, "main", "device", "list")
    assert "openhaptics" in drivers
    assert "inverse3" not in drivers
    assert "│ select" not in run(core, tmp_path, "main", "model", "--help")
    assert "--share" not in run(core, tmp_path, "main", "demo", "--help")
    assert "sharing" not in run(core, tmp_path, "main", "scene", "explain", "demo", "--no-measure")
