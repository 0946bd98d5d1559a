"""The first start, on a machine that has compiled nothing yet, and the next."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from service_processes import scene, session

import mmt

pytestmark = pytest.mark.timeout(600)
"""Compiling from nothing takes minutes on a busy machine."""

FIRST_START = """
import json, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from mmt.core.kernel_cache import compile_kernels
from mmt.leader.part import Session
from mmt.leader.parts import build_parts, first_numerics_of, numerics_of
from mmt.scene.files import load_scene

whole, compiled = Dispatcher.compile, []

def compile_noted(self, signature):
    entry = whole(self, signature)
    if not self.stats.cache_hits:
        compiled.append(self.py_func.__qualname__)
    return entry

Dispatcher.compile = compile_noted
scene, told = load_scene(Path(sys.argv[1])), []
compilation = compile_kernels(numerics_of(scene), told.append, first_numerics_of(scene))
if compilation is not None:
    compilation.finish()
build_parts(Session(scene))
print(json.dumps([told, compiled]))
"""
"""Have what a scene needs compiled, load its parts, and tell what was compiled in this process."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the numerics are compiled to: nothing is there yet."""
    return tmp_path_factory.mktemp("first") / "cache"


@pytest.fixture(scope="module")
def starts(cache: Path) -> list[tuple[list[str], list[str]]]:
    """What a first and a second start of a short session told, and compiled by themselves."""
    runs = [
        subprocess.run(
            [sys.executable, "-c", FIRST_START, scene("demo")],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
            timeout=500,
        )
        for _ in range(2)
    ]
    return [json.loads(run.stdout) for run in runs]


def test_a_short_session_finds_its_kernels_compiled_by_processes_beside_each_other(
    starts: list[tuple[list[str], list[str]]],
) -> None:
    (told, compiled), again = starts
    assert len(told) == 1
    assert told[0].startswith("compiling the numerics, at the first start only")
    assert compiled == []
    assert again == [[], []]


@pytest.mark.usefixtures("starts")
def test_a_long_session_begins_before_modelling_is_compiled_and_is_modelled_whole(
    cache: Path, tmp_path: Path
) -> None:
    for kernel in cache.rglob("bottom_up.*.nbi"):
        kernel.unlink()
    recording = tmp_path / "session.mcap"
    arguments = ("--duration", 600, "--record", recording)
    with session(tmp_path, "demo", *arguments, NUMBA_CACHE_DIR=str(cache)) as (leader, follower):
        leader.wait_for(lambda: any(status["samples"] for status in leader.lines("status")))
        leader.signal(signal.SIGTERM)
        assert (leader.end(), follower.end()) == (0, 0)
    assert list(cache.rglob("bottom_up.*.nbi"))
    assert any(event.startswith("modelling begins: ") for event in leader.events())
    texture, recorded = leader.summary()["texture"], mmt.read_session(recording)
    assert texture["dropped_frames"] == texture["late_frames"] == 0
    table = mmt.load_scene(Path(scene("demo"))).texture
    assert table is not None
    history = mmt.build_model(recorded.frames, table.settings(1000.0), table.update_period_s)
    assert recorded.models
    for time_s, model in recorded.models:
        expected = history.model_at(time_s)
        assert expected is not None
        assert model == expected.to_bytes()
