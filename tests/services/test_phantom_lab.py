"""The papers' laboratory, every device emulated at its wire, from the sensor to the coil."""

import json
import re
import shlex
import shutil
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from python_programs import run_mmt

from mmt.cli.demo import pair_named, write_emulated
from mmt.core.errors import InputError
from mmt.evaluation.coil import coil_figures
from mmt.scene.files import load_scene
from mmt.testing.emulated.openhaptics.phantom import ROBOT_N_MM, WALL_N_MM, series_n_mm


def test_both_scenes_agree_and_are_emulated_at_their_wires(tmp_path):
    pair = pair_named(Path("phantom-lab"))
    leader, follower = (load_scene(file) for file in pair)
    assert leader.channels() == follower.channels()
    assert leader.reports_contact
    assert follower.reports_contact
    for file in write_emulated(pair, tmp_path):
        tables = tomllib.loads(file.read_text())
        assert tables["network"]["profile"] == "wan"
        assert "token_file" not in tables["link"]
        drivers = [tables["handle"], *map(tables["devices"].get, ("robot", "force_sensor"))]
        assert all(each["driver"].startswith("virtual-") for each in drivers)
    assert pair_named(Path("no-such-lab")) is None
    for side in pair:
        text = side.read_text().replace('"ati-net-ft"', '"ati-gauges"')
        (tmp_path / side.name.replace("phantom", "other")).write_text(text)
    other = pair_named(tmp_path / "other-lab")
    assert other is not None
    with pytest.raises(InputError, match="ati-gauges has no emulated device"):
        write_emulated(other, tmp_path / "out")


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_vibration_at_the_coil_begins_and_ends_with_the_hands_own_contact(tmp_path):
    """Over a network whose round trip is some 80 ms, on a machine that may be busy."""
    page = Path(__file__).parents[2] / "docs" / "how-to" / "phantom-lab.md"
    (block,) = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.splitlines():  # every command of the page; the first is the demo
        words = ("main", *shlex.split(line)[1:])
        ended = run_mmt(tmp_path, *words, XDG_DATA_HOME=str(tmp_path / "data"))
        assert "Traceback" not in ended.stderr
        if "device test" not in line:  # a busy machine's readings may be late, which it tells
            assert ended.returncode == 0, (line, ended.stderr)
        if "mmt demo" in line:
            told = ended.stdout
    figures = json.loads((tmp_path / "figures.json").read_text())
    start_s = figures["leader"]["texture"]["start_s"]
    if start_s is None or start_s > 20.0:  # the last 10 s have three touches or more
        pytest.skip("this machine is too busy for a model in the time of the session")
    coil = figures["coil"]
    assert coil["touches"] >= 3
    assert abs(coil["begin_ms"]) < 40.0
    assert abs(coil["end_ms"]) < 40.0
    assert abs(coil["level_error_db"]) < 6.0
    assert 0.0 < coil["output_latency_ms"] < 60.0
    contact = figures["leader"]["handle"]["contact"]
    assert contact["surface_mm"] == pytest.approx(0.0, abs=0.5)
    assert contact["stiffness_n_mm"] == pytest.approx(series_n_mm(), rel=0.15)
    surface = figures["leader"]["feedback"]["surface"]
    assert surface["stiffness_n_mm"] == pytest.approx(WALL_N_MM, rel=0.3)
    assert figures["leader"]["vibration"]["not_finite"] == 0
    assert figures["evaluation"]["at_skin"]["played_share"] > 0.5
    assert re.search(r"error \d\.\d dB, \d\.\d at the skin", " ".join(told.split()))
    way = np.load(tmp_path / "lab" / "hand.npz")["way"]
    assert way.shape[1] == 7
    assert np.isfinite(way).all()


@settings(max_examples=5)
@given(st.floats(0.1, 5.0), st.integers(0, 9))
def test_the_coil_is_judged_by_the_force_that_the_runs_robot_makes(robot_n_mm, seed):
    times_s = np.arange(6000) / 1000.0
    force_n = 1.5 * np.sin(3.0 * times_s)
    volts = np.random.default_rng(seed).normal(size=len(times_s))
    with TemporaryDirectory() as folder:
        coil = Path(folder, "coil.npz")
        np.savez(coil, volts=volts, rate_hz=1000.0, start_s=0.0)
        figures = []
        for stiffness_n_mm in (ROBOT_N_MM, robot_n_mm):
            way = np.zeros((len(times_s), 7))
            way[:, 0], way[:, 4] = times_s, 80.0
            way[:, 3] = -force_n / series_n_mm(stiffness_n_mm)  # deeper where it gives way
            hand = Path(folder, "hand.npz")
            np.savez(hand, way=way)
            figures.append(coil_figures(hand, coil, "plastic", stiffness_n_mm, 6.0, 0.0))
    assert figures[0]["touches"]
    assert figures[1] == pytest.approx(figures[0], abs=0.02)


def test_without_a_compiler_the_demo_ends_with_a_sentence(tmp_path):
    variables = {"CC": "no-such-compiler", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    ended = run_mmt(tmp_path, "main", "demo", "phantom-lab", **variables)
    assert ended.returncode != 0
    assert "install a C compiler" in ended.stderr
    assert "Traceback" not in ended.stderr
