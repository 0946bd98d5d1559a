"""No command replaces a file without --force."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_runs import output_of
from frame_samples import made_frames
from player_samples import flat_texture

from mmt.cli.common import run_app
from mmt.cli.demo import pair_named
from mmt.cli.main import app
from mmt.cli.running.scene_services import DemoRun
from mmt.core.errors import InputError
from mmt.core.files.existing import free_folder, free_path
from mmt.session.files import read_session, write_session

KEPT = b"a recording of an hour"


def run(arguments, capsys):
    """Return exit code and messages, as the installed program ends."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["mmt", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            run_app(app, "mmt")
    return ended.value.code, capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ("session", "simulate", "{out}.mcap", "--duration", "0.2"),
        ("session", "import", "{source}.npz", "{out}.mcap"),
        ("session", "export", "{source}.mcap", "{out}.csv"),
        ("session", "recover", "{source}.mcap", "{out}.mcap"),
        ("model", "import", "{source}.xml", "{out}.npz"),
        ("model", "export", "{source}-model.npz", "{out}.xml"),
        ("model", "export", "{source}-model.npz", "{out}.wav"),
    ],
    ids=" ".join,
)
def test_a_file_that_exists_is_replaced_only_with_force(tmp_path, capsys, command):
    for suffix in ("mcap", "npz"):
        write_session(tmp_path / f"source.{suffix}", made_frames(0, 200))
    flat_texture(1.0).save(tmp_path / "source-model.npz")
    output_of("model", "export", tmp_path / "source-model.npz", tmp_path / "source.xml")
    names = {"source": tmp_path / "source", "out": tmp_path / "out"}
    arguments = [part.format(**names) for part in command]
    (target,) = (Path(each) for each in arguments if "out." in each)
    target.write_bytes(KEPT)
    code, said = run(arguments, capsys)
    refused = f"{target}: it exists already; choose another name, or --force replaces it"
    assert code == 2
    assert refused in " ".join(said.split())
    assert target.read_bytes() == KEPT
    code, said = run([*arguments, "--force"], capsys)
    assert code == 0, said
    assert target.read_bytes() != KEPT


def test_no_trial_is_made_where_one_of_them_exists(tmp_path, capsys):
    (tmp_path / "oak-2.mcap").write_bytes(KEPT)
    arguments = ("session", "simulate", tmp_path / "oak.mcap", "--trials", 3, "--duration", 0.2)
    assert run(arguments, capsys)[0] == 2
    assert [path.name for path in tmp_path.iterdir()] == ["oak-2.mcap"]


def test_recovering_twice_by_the_default_name_keeps_what_was_saved_first(tmp_path, capsys):
    write_session(tmp_path / "run.mcap", made_frames(0, 100))
    assert run(("session", "recover", tmp_path / "run.mcap"), capsys)[0] == 0
    assert run(("session", "recover", tmp_path / "run.mcap"), capsys)[0] == 0
    for name in ("run.recovered.mcap", "run.recovered-2.mcap"):
        np.testing.assert_array_equal(read_session(tmp_path / name).frames, made_frames(0, 100))


def test_a_free_path_is_the_name_itself_or_the_least_number(tmp_path, monkeypatch):
    wanted = tmp_path / "session.mcap"
    assert free_path(wanted) == wanted
    wanted.touch()
    (tmp_path / "session-3.mcap").touch()
    assert free_path(wanted) == tmp_path / "session-2.mcap"
    (tmp_path / "session-2.mcap").touch()
    assert free_path(wanted) == tmp_path / "session-4.mcap"
    (tmp_path / "run").mkdir()
    assert free_folder(tmp_path / "run") == tmp_path / "run", "it holds no report or recording"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Path, "exists", lambda _: True)
    for folder in (Path(), Path(".."), Path("/")):
        with pytest.raises(InputError, match="a number goes behind the name"):
            free_folder(folder)


@pytest.mark.parametrize("name", ["report.html", "session.mcap", "model.npz"])
def test_a_demo_writes_beside_what_an_earlier_one_has_left(tmp_path, monkeypatch, capsys, name):
    async def services(*_, **__):
        return DemoRun()

    monkeypatch.setattr("mmt.cli.demo.run_services", services)
    wanted = tmp_path / "run"
    wanted.mkdir()
    (wanted / name).write_bytes(KEPT)
    assert run(["demo", "--output", wanted], capsys)[0] == 0
    assert [path.name for path in wanted.iterdir()] == [name]
    assert (tmp_path / "run-2").is_dir()


def test_a_demo_does_not_replace_the_scenes_that_it_emulates(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pair = pair_named(Path("phantom-lab"))
    assert pair is not None
    for file in pair:
        (tmp_path / file.name).write_bytes(file.read_bytes())
    for more in ((), ("--force",)):
        named = tmp_path / "phantom-lab"
        code, said = run(["demo", named, "--output", ".", *more], capsys)
        assert code == 2
        assert "--output .: the scenes are there; name another folder" in " ".join(said.split())
    assert all((tmp_path / file.name).read_bytes() == file.read_bytes() for file in pair)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize(
    ("scene", "earlier"), [("demo", True), ("phantom-lab", True), ("phantom-lab", False)]
)
def test_a_demos_coil_is_that_of_its_own_run(tmp_path, monkeypatch, capsys, scene, earlier):
    """What cannot be read of it does not hold up the rest."""

    def leave():
        for name in ("hand.npz", "coil.npz"):
            (tmp_path / name).write_bytes(b"cut off")

    async def services(*_, **__):
        if not earlier:
            leave()
        switch = {"mode": "synthesized", "time_s": 1.0}
        vibration = {"switches": [switch], "actuator": {"latency_ms": 1.0}}
        return DemoRun({"session": {"duration_s": 2.0}, "vibration": vibration})

    if earlier:
        leave()
    monkeypatch.setattr("mmt.cli.demo.run_services", services)
    figures = tmp_path / "figures.json"
    command = ["demo", scene, "--output", tmp_path, "--force", "--json", figures]
    code, said = run(command, capsys)
    assert code == (0 if earlier else 1)
    assert ("hand.npz and coil.npz: this is not a .npz archive" in said) is not earlier
    assert json.loads(figures.read_text()).keys() == {"leader"}
