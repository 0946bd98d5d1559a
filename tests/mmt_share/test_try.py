"""``mmt try`` and ``mmt play``: from files to a page that plays them."""

import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from unittest.mock import AsyncMock

import numpy as np
import pytest
from command_runs import output_of, refusal, run
from player_samples import flat_texture
from service_processes import LONGEST_S, Service

import mmt
from mmt.core.errors import MmtError
from mmt.scene.files import scene_from_tables
from mmt.session.files import write_session
from mmt_share.commands import trying

NAMES = ("position_mm", "force_n", "acceleration_m_s2")


@pytest.fixture(scope="module")
def measured():
    """Time, position, force and acceleration of a stroked surface, (n, 10)."""
    frames, _ = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=8.0)
    return np.column_stack([frames["sequence"] / 1000.0, *(frames[name] for name in NAMES)])


def write(path, header, values):
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.6f")
    return path


def served_until_ctrl_c(folder, *command):
    """Run a command until its page has come, and interrupt it; return the process."""
    with Service("main", *command, "--port", 0, cwd=folder) as serving:
        serving.wait_for(lambda: "/player/" in serving.stderr)
        (url,) = re.findall(r"http://\S+", serving.stderr)
        with urllib.request.urlopen(url, timeout=LONGEST_S) as answer:
            assert b"mmt texture player" in answer.read()
        serving.signal(signal.SIGINT)
        assert serving.end() == 0
    return serving


def test_a_model_is_played(tmp_path):
    flat_texture(1.0).save(tmp_path / "cork.npz")
    served_until_ctrl_c(tmp_path, "play", "cork.npz")


def test_a_table_whose_columns_tell_all_is_played(tmp_path, measured, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "mine.csv", "t,px_mm,py_mm,pz_mm,fx,fy,fz,ax,ay,az", measured)
    trying = served_until_ctrl_c(tmp_path, "try", "mine.csv")
    assert "imported as by: mmt session import mine.csv mine.mcap" in trying.stdout
    (share,) = re.findall(r"(\d+) % of strokes should feel right", trying.stderr)
    assert 50 < int(share) <= 100
    model = mmt.load_model(tmp_path / "mine.npz")
    assert len(model.samples) > 5
    again = refusal("try", "mine.csv")
    assert "mine.npz" in again
    assert "--force" in again


def test_a_session_of_mmt_is_modelled_as_it_was_recorded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(trying, "serve_until_ended", served := AsyncMock())
    scene = scene_from_tables(
        {"link": {}, "simulated": {}, "hand": {}, "texture": {"method": "published"}}
    )
    frames, _ = mmt.simulate_session(scene, surface="wood", duration_s=6.0)
    write_session(tmp_path / "run.mcap", frames, scene=scene.dump())
    output_of("try", "run.mcap")
    served.assert_awaited_once()
    output_of("model", "build", "run.mcap", "built.npz")
    tried, built = (mmt.load_model(tmp_path / f"{name}.npz") for name in ("run", "built"))
    assert tried.method == "published"
    assert tried.to_bytes() == built.to_bytes()


@pytest.mark.skipif(os.name != "posix", reason="there are no pseudo-terminals")
def test_what_the_columns_do_not_tell_is_asked(tmp_path, measured):
    path = write(tmp_path / "odd.csv", "one,two,three,four", measured[:, [1, 2, 6, 9]])
    person, terminal = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "mmt.cli.entry", "main", "try", str(path), "--port", "0"],
        cwd=tmp_path,
        stdin=terminal,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as trying:
        os.write(person, b"1000\none two 0\nthree\nfour\n")
        assert trying.stderr is not None
        said = ""
        while "/player/" not in said and (line := trying.stderr.readline()):
            said += line
        trying.send_signal(signal.SIGINT)
        trying.stderr.read()
        assert trying.wait(LONGEST_S) == 0, said
    for each in (person, terminal):
        os.close(each)
    for asked in ("Rows a second (Hz)", "position along", "force along", "acceleration along"):
        assert asked in said
    samples = mmt.load_model(tmp_path / "odd.npz").samples
    assert samples.speed_mm_s.max() > 50.0


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("one,two,two,four", [1, 2, 6, 9], "no column was found for time; say it by --rate HZ"),
        ("t,px,py,az", [0, 1, 2, 9], "no column was found for force; say it by --map force_z=NAME"),
    ],
)
def test_without_a_person_it_says_what_is_missing(tmp_path, measured, header, columns, said):
    path = write(tmp_path / "odd.csv", header, measured[:, columns])
    result = run("try", path)
    assert said in str(result.exception)
    assert ("look: 2 columns are called two" in result.output) == ("two" in header)


def test_too_few_strokes_are_said(tmp_path, measured, monkeypatch):
    monkeypatch.chdir(tmp_path)
    still = measured[:300].copy()
    still[:, 1:7] = 0.0
    path = write(tmp_path / "still.csv", "t,px_mm,py_mm,pz_mm,fx,fy,fz,ax,ay,az", still)
    assert "too few steady strokes" in refusal("try", path, kind=MmtError)
    assert not (tmp_path / "still.npz").exists()


def test_what_cannot_be_played_is_explained(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("more").mkdir()
    for model in ("cork.npz", "more/cork.npz"):
        flat_texture(1.0).save(tmp_path / model)
    Path("other.csv").write_text("other,columns\n")
    for words, told in (
        ("cork.npz --record touch.csv", "must end in .mcap"),
        ("cork.npz more/cork.npz", "cork: two textures have this name"),
        ("nothing", "shipped are"),
        ("cork.npz --host 0.0.0.0", "be the player: set a token"),
        ("cork.npz --key key.pem", "certificate and key belong together"),
        ("cork.npz --results other.csv", "name another file"),
    ):
        assert told in refusal("play", *words.split())
