"""Mistakes on the command line: exit code 2, a sentence that helps, no traceback."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from frame_samples import made_frames
from python_programs import run_mmt

from mmt.cli import follower, leader, main
from mmt.cli.common import run_app
from mmt.core import extras
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, write_session

APPS = {"mmt": main.app, "mmt-leader": leader.app, "mmt-follower": follower.app}

LONG = "x" * 300

SCENES = {
    "long": f"[link]\ntoken_file = '{LONG}'\n",
    "wrong-key": "[session]\nnmae = 'x'\n",
    "no-model": "[hand]\n[rendering]\nmodel = 'none.npz'\n[actuator]\n",
    "half": "[hand]\n[rendering]\n[actuator]\n",
    "velvet": "[link]\n[simulated]\nsurface = 'velvet'\n[hand]\n[recording]\n",
    "no-actuator": (
        "[link]\n[simulated]\n[hand]\n[playout]\n"
        "[actuator]\ndriver = 'haptuator-sound'\nfull_scale_v = 1.0\nvolts_per_m_s2 = 0.1\n"
    ),
    "no-driver": "[link]\n[devices]\nrobot = 'nowhere:Robot'\n[hand]\n[playout]\n[actuator]\n",
}

SURFACES = "surface is 'velvet', allowed are plastic, mesh, fabric"
CUT_OFF = "it ends before it was finished; save what is readable with: mmt session recover"

CASES = [
    ("mmt-leader demo --json - --json-lines", "both take standard output: give one"),
    # scenes, with both services
    ("mmt-leader none.toml", "scene none.toml: no such file; the examples are anisotropic, demo"),
    (f"mmt-leader {LONG}", f"{LONG}: File name too long: correct the path"),
    (f"mmt session import {LONG} x.mcap", f"{LONG}: File name too long: correct the path"),
    ("mmt-leader long.toml", f"{LONG}: File name too long: correct the path"),
    ("mmt-leader wrong-key.toml", "session.nmae is not a key; allowed are name, duration_s"),
    ("mmt-leader half.toml", "[rendering] needs a model: add [texture], or name a saved one"),
    ("mmt-leader no-model.toml", "model none.npz: No such file"),
    ("mmt-leader demo --duration 0", "error: --duration: session.duration_s is 0.0: Input should"),
    ("mmt-leader", "Missing argument 'SCENE'"),
    ("mmt-leader stream-only --report out", "--report needs a recording: give --record FILE"),
    ("mmt-leader model-only --record x.mcap", "[recording] needs a follower: add [link]"),
    ("mmt-leader model-only --model text.npz", "model text.npz: not a texture model"),
    ("mmt-leader stream-only --record text.npz/x.mcap", "recording text.npz/x.mcap: "),
    ("mmt-follower velvet.toml", SURFACES),
    ("mmt-follower no-driver.toml", "device 'nowhere:Robot': module nowhere cannot be imported"),
    ("mmt-follower model-only", "the scene has no follower: add one of [simulated], [replay]"),
    ("mmt-follower replay", "[replay] names no file: set its key 'file' or give --replay FILE"),
    ("mmt-follower demo --leader nonsense", "leader's URL 'nonsense': allowed is http://HOST"),
    ("mmt-follower demo --speed 2", "--speed is for a replay"),
    ("mmt-follower replay --replay whole.mcap --speed 0", "error: --speed: replay.speed is 0.0"),
    # sessions that cannot be replayed
    ("mmt-follower demo --replay folder.mcap", "session folder.mcap: Is a directory"),
    ("mmt-follower demo --replay cut.mcap", CUT_OFF),
    ("mmt-follower demo --replay half.toml", ".toml cannot be read; the suffix must be one of"),
    ("mmt-follower demo --replay text.csv", "import it first: mmt session import"),
    ("mmt-follower demo --replay bare.mcap", "the session has no acceleration, which the scene"),
    # the demo
    ("mmt demo /", "scene /: no such file"),
    ("mmt demo --replay none.mcap", "session none.mcap: No such file"),
    ("mmt demo --output text.csv/out", "--output text.csv/out: "),
    # sessions as files
    ("mmt session simulate x.pdf --duration 0.1", "session x.pdf: .pdf cannot be written"),
    ("mmt session simulate none/x.mcap --duration 0.1", "cannot write none/x.mcap: No such file"),
    ("mmt session simulate x.mcap --duration 0", "duration_s is 0.0, it must be above 0"),
    ("mmt session simulate x.mcap --path none.npz", "path none.npz: No such file"),
    ("mmt session import text.csv x.mcap", "import text.csv: it holds none of position_mm"),
    ("mmt session import text.npz x.mcap", "import text.npz: this is not a .npz archive"),
    ("mmt session import whole.mcap x.mcap", "a session of mmt is one as it is, without import"),
    ("mmt session info [/bold]:sad:.mcap", "session [/bold]:sad:.mcap: No such file"),
    ("mmt session info none.mcap", "session none.mcap: No such file"),
    ("mmt session info text.mcap", "session text.mcap: this is not an MCAP file"),
    ("mmt session info whole.mcap --json text.csv/x.json", "cannot write text.csv/x.json: "),
    ("mmt session export whole.mcap none/x.csv", "cannot write none/x.csv"),
    ("mmt session simulate .. --trials 2", "..: a number goes behind the name, and this is none"),
    ("mmt session recover .", "session .: Is a directory"),
    ("mmt session recover whole.mcap whole.mcap", "name another file to write to"),
    ("mmt session import text.csv x.mcap --map force", "must have the form NAME=VALUE"),
    ("mmt session export whole.mcap whole.npz x.csv", "takes one session, not 2"),
    ("mmt session export whole.mcap x.csv --fps 30", "--fps is for a data set"),
    ("mmt session export whole.mcap x.csv --task x", "--task is for a data set"),
    ("mmt session export whole.mcap x --to lerobot --scalars", "--scalars is for .mcap files"),
    ("mmt session export whole.mcap x --to zarr", "--to zarr: allowed are lerobot"),
    ("mmt session", "Usage: mmt session"),
    # devices
    ("mmt device test nothing", "driver 'nothing' is not known"),
    ("mmt device test a:B --set x", "write KEY=VALUE"),
    ("mmt device test demo", "names no device"),
    ("mmt device test demo --set x=1", "a scene has its own"),
    ("mmt device test ati-net-ft --role handle", "cannot be that; allowed are force_sensor"),
    ("mmt device test virtual-lab --role handle", "has no handle; it has robot, force_sensor, "),
    ("mmt device calibrate adxl335-serial --keep whole.npz", "whole.npz: it exists already"),
    ("mmt device equalise --keep whole.npz", "whole.npz: it exists already"),
    # the rest
    ("mmt evaluate none.mcap", "session none.mcap: No such file"),
    ("mmt evaluate whole.mcap --step 0", "step_s is 0.0"),
    ("mmt model info whole.npz", "not a texture model: the array 'format_version'"),
    ("mmt model build whole.mcap x.pdf", "the name of a model file must end in .npz"),
    ("mmt model push none.npz --to http://x", "No such file"),
    ("mmt model push text.npz --to http://x", "not a texture model"),
    ("mmt surface 2 --leader 127.0.0.1:1", "allowed is http://HOST:PORT"),
    ("mmt lab sweep whole.mcap --workers 2 --dask tcp://x:1", "a cluster has its own workers"),
    ("mmt lab sweep whole.mcap --workers 0", "Invalid value for '--workers'"),
    ("mmt bench nothing", "bench nothing: allowed are burg, devices"),
    ("mmt evaluat", "No such command 'evaluat'. Did you mean 'evaluate'?"),
    ("mmt", "Usage: mmt"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that can be used, and many that cannot."""
    directory = tmp_path_factory.mktemp("mistakes")
    for name, text in SCENES.items():
        (directory / f"{name}.toml").write_text(text)
    frames = made_frames(0, 200)
    write_session(directory / "whole.mcap", frames)
    write_session(directory / "whole.npz", frames)
    export_session(RecordedSession(frames), directory / "whole.csv")
    write_session(directory / "bare.mcap", made_frames(0, 200, ("position", "force")))
    whole = (directory / "whole.mcap").read_bytes()
    (directory / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (directory / "folder.mcap").mkdir()
    for suffix in ("mcap", "npz", "csv"):
        (directory / f"text.{suffix}").write_text("neither,this\nnor,that\n")
    return directory


def run(command, monkeypatch, capsys):
    """Run a command line in this process; return exit code, output and messages."""
    program, *arguments = command.split()
    monkeypatch.setattr(sys, "argv", [program, *arguments])
    with pytest.raises(SystemExit) as ended:
        run_app(APPS[program], program)
    code = ended.value.code
    assert isinstance(code, int)
    return code, *capsys.readouterr()


LACKING = {
    "virtual-arm": ("rtde_control", "need ur-rtde"),
    "no-actuator.toml": ("sounddevice", "needs sounddevice"),
}
"""By the scene: the package that is not there, and how its lack is told."""


@pytest.mark.parametrize("scene", LACKING)
def test_a_demo_whose_driver_lacks_its_package_starts_nothing(
    scene, folder, tmp_path, monkeypatch, capsys
):
    package, sentence = LACKING[scene]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        extras, "find_spec", lambda name: None if name == package else find_spec(name)
    )
    named = folder / scene if scene.endswith(".toml") else scene
    code, _, stderr = run(f"mmt demo {named}", monkeypatch, capsys)
    assert code == 2
    assert f"{sentence}, which is not installed; install it with: " in stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("command", "sentence"), CASES, ids=[command for command, _ in CASES])
def test_a_mistake_is_explained(command, sentence, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    code, stdout, stderr = run(command, monkeypatch, capsys)
    assert code == 2
    assert sentence in stderr + stdout
    assert "Traceback" not in stderr
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("command", "usage", "names"),
    [
        ("mmt-leader", "[OPTIONS] SCENE", "Serve one session"),
        ("mmt-follower", "[OPTIONS] SCENE", "[link]"),
        ("mmt evaluate", "[OPTIONS]", "[texture]"),
        ("mmt bench", "[OPTIONS] [STAGE...]", "burg, devices, evaluate"),
        ("mmt stability", "[OPTIONS] [FAMILY...]", "loop, lsf, model"),
        ("mmt lab stability", "[OPTIONS] [FAMILY...]", "loop, lsf, model"),
    ],
)
def test_help_lists_what_can_be_named(command, usage, names, monkeypatch, capsys):
    code, stdout, stderr = run(f"{command} --help", monkeypatch, capsys)
    assert (code, stderr) == (0, "")
    assert "\\[" not in stdout, "markup that was not resolved"
    words = " ".join(stdout.replace("│", " ").split())
    assert f"Usage: {command} {usage}" in words
    assert names in words
    assert usage.endswith("...]") == ("; all if none is named." in words)


@pytest.mark.parametrize("program", APPS)
def test_every_program_tells_its_version(program, monkeypatch, capsys):
    code, stdout, _ = run(f"{program} --version", monkeypatch, capsys)
    assert code == 0
    assert stdout.startswith("mmt-haptics ")


def test_a_process_ends_like_that_too(folder):
    long_name = "a-name-that-is-longer-than-a-line-of-eighty-characters/" * 3 + "x.mcap"
    ended = run_mmt(folder, "main", "session", "info", long_name, COLUMNS="80")
    assert ended.returncode == 2
    assert ended.stderr == f"error: session {long_name}: No such file or directory\n"
    assert ended.stdout == ""


def test_json_to_standard_output_stands_there_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for command in ("mmt model list", "mmt device list", "mmt scene explain demo --no-measure"):
        code, stdout, stderr = run(f"{command} --json -", monkeypatch, capsys)
        assert code == 0, stderr
        assert json.loads(stdout), command
        code, stdout, _ = run(command, monkeypatch, capsys)
        assert stdout, "what follows writes its tables there again"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="closes standard streams by a shell")
def test_closed_streams_and_characters_that_the_output_lacks_fail_nothing(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,force_z_n,ma\u00df\n0,1,1\n0.001,2,2\n", "utf-8")
    run_mmt = [sys.executable, "-m", "mmt.cli.entry", "main", "session", "inspect", "a.csv"]
    closed = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *run_mmt]
    subprocess.run(closed, cwd=tmp_path, check=True, timeout=150)
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii:strict"}
    shown = subprocess.run(
        run_mmt, cwd=tmp_path, env=ascii_only, check=True, capture_output=True, timeout=150
    )
    assert rb"ma\xdf" in shown.stdout
