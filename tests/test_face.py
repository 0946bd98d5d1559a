"""``import mmt``: the names of the library, what they cost, and what they say of themselves."""

import ast
import doctest
import importlib
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mmt

CONTRACT = {
    "read_session", "import_session", "load_model", "Synthesizer", "build_model",
    "ModellingSettings", "follow_surfaces", "evaluate_session", "simulate_session", "Scene",
    "Leader", "Follower",
}  # fmt: skip

LONGEST_IMPORT_S = 0.1

MEASURE = """
import json, sys, time
before = set(sys.modules)
started = time.process_time()
import mmt
spent_s = time.process_time() - started
print(json.dumps([spent_s, sorted({name.partition(".")[0] for name in set(sys.modules) - before})]))
"""


def test_importing_it_is_quick_and_brings_no_numerics():
    measured = []
    for _ in range(3):
        output = subprocess.check_output([sys.executable, "-c", MEASURE], text=True, timeout=150)
        measured.append(json.loads(output))
    assert min(spent_s for spent_s, _ in measured) < LONGEST_IMPORT_S
    heavy = {"numba", "scipy", "numpy", "pydantic", "matplotlib", "rich", "mcap", "aiohttp"}
    assert heavy.isdisjoint(measured[0][1])


def test_every_name_is_there_and_listed_with_a_sentence_of_help():
    assert CONTRACT <= set(mmt.__all__) <= set(dir(mmt))
    for name in set(mmt.__all__) - {"__version__"}:
        text = inspect.getdoc(getattr(mmt, name))
        assert text, name
        assert text.splitlines()[0].endswith((".", ":")) or "." in text, name
    with pytest.raises(AttributeError, match="no attribute 'read_sessions'"):
        mmt.read_sessions  # noqa: B018


FRAMES = np.zeros(3, [("sequence", "u8")])
MISTAKEN = {
    "session is of type ndarray: what mmt.read_session": [
        lambda: mmt.evaluate_session(FRAMES),
        lambda: mmt.evaluate_surfaces(FRAMES),
        lambda: mmt.export_session(FRAMES, "a.npz"),
    ],
    "scene is 'demo', allowed is Scene": [
        lambda: mmt.Leader("demo"),
        lambda: mmt.Follower("demo"),
        lambda: mmt.simulate_session("demo"),
    ],
    "frames are of type str": [lambda: mmt.build_model("a.mcap", mmt.ModellingSettings())],
    "units is 'mm', it must be a dict": [lambda: mmt.import_session("a.csv", units="mm")],
    "rate_hz is '1000', allowed is": [lambda: mmt.import_session("a.csv", rate_hz="1000")],
    "seed is 'a', allowed is": [lambda: mmt.simulate_session(mmt.Scene(), seed="a")],
}


@pytest.mark.parametrize("said", MISTAKEN)
def test_something_of_another_kind_is_refused_with_what_is_needed(said):
    for mistaken in MISTAKEN[said]:
        with pytest.raises(mmt.InputError, match=re.escape(said)):
            mistaken()


def test_type_checkers_see_every_name():
    tree = ast.parse(Path(mmt.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen | {"__version__"} == set(mmt.__all__)


def test_a_checker_takes_the_pages_example_and_no_name_that_there_is_not(tmp_path):
    pytest.importorskip("mypy")
    root = Path(__file__).parents[1]
    page = (root / "docs" / "how-to" / "numerics.md").read_text(encoding="utf-8")
    sample = tmp_path / "sample.py"
    sample.write_text(page.split("```python\n")[1].split("```")[0] + "mmt.read_sesion\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(sample)]
    found = subprocess.run(
        command, check=False, cwd=root, capture_output=True, text=True, timeout=300
    )
    (error,) = found.stdout.splitlines()
    assert "read_sesion" in error


@pytest.mark.parametrize(
    "module",
    ["mmt", *(f"mmt.{name}" for name in (
        "session.data", "session.files", "texture.model.texture_model", "texture.online.history",
        "evaluation.evaluate",
    ))],
)  # fmt: skip
def test_the_examples_in_docstrings_run(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried > 0
    assert failed == 0


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="plastic", duration_s=12.0)
    path = str(tmp_path_factory.mktemp("face") / "a.mcap")
    mmt.write_session(path, frames, annotations=truth)
    return mmt.read_session(path)


def test_a_session_says_what_it_holds(simulated):
    assert "a.mcap: 12.0 s, 12000 frames of position" in repr(simulated)
    columns = simulated.columns()
    assert list(columns)[:3] == ["sequence", "time_s", "position_x_mm"]
    assert {values.shape for values in columns.values()} == {(12000,)}


def test_a_model_history_tells_the_model_at_any_time(simulated):
    history = mmt.build_model(simulated.frames, mmt.ModellingSettings(), update_s=1.0)
    assert history.start_s is not None
    assert history.model_at(0.2) is None
    early, late = history.model_at(history.start_s), history.model_at(12.0)
    assert len(early.samples) < len(late.samples)
    assert late is history.updates[-1].model
    assert f"started at {history.start_s:.1f} s" in repr(history)
    with pytest.raises(mmt.InputError, match="no frames"):
        mmt.build_model(simulated.frames[:0])


def test_surfaces_are_followed_by_session_time():
    pieces = [
        mmt.simulate_session(mmt.Scene(), surface=name, duration_s=8.0)[0]
        for name in ("plastic", "sandpaper")
    ]
    pieces[1]["sequence"] += 8000
    pieces[1]["time_ns"] += 8_000_000_000
    frames = np.concatenate(pieces)
    changes = list(mmt.follow_surfaces(frames, mmt.ModellingSettings()))
    assert [change.surface for change in changes] == [2]
    assert 7.9 < changes[0].from_s < changes[0].time_s < 12.0
    assert changes[0].kind == "new"
    assert list(mmt.follow_surfaces(frames[:0])) == []


def test_an_evaluation_prints_what_the_command_prints(simulated):
    result = mmt.evaluate_session(simulated)
    assert [step.time_s for step in result.steps] == [2.5, 5.0, 7.5, 10.0]
    assert "Evaluation of a: 4 steps over 12.0 s, started at " in repr(result)
    assert "10.0" in str(result)
    assert max(map(len, str(result).splitlines())) <= 80


def test_a_scene_is_loaded_by_its_name_as_text_or_path():
    assert mmt.load_scene("demo") == mmt.load_scene(Path("demo"))
