"""The first start, on a machine that has compiled nothing yet, and the next."""

import json
import os
import signal
import subprocess
import sys

import pytest
from service_processes import Service, follower_of, scene

LONGEST_COMPILATION_S = 400.0
"""From nothing, on a busy machine."""

pytestmark = pytest.mark.timeout(2 * LONGEST_COMPILATION_S)

FIRST_START = """
import json, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from mmt.core.kernel_cache import compile_kernels
from mmt.leader.part import Session
from mmt.leader.parts import build_parts, numerics_of
from mmt.scene.files import load_scene

whole, compiled = Dispatcher.compile, []

def compile_noted(self, signature):
    entry = whole(self, signature)
    if not self.stats.cache_hits:
        compiled.append(self.py_func.__qualname__)
    return entry

Dispatcher.compile = compile_noted
scene, told = load_scene(Path(sys.argv[1])), []
compile_kernels(numerics_of(scene), told.append)
build_parts(Session(scene))
print(json.dumps([told, compiled]))
"""
"""Have what a scene needs compiled, load its parts, and tell what was compiled in this process."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Where the numerics are compiled to: nothing is there yet."""
    return tmp_path_factory.mktemp("first") / "cache"


@pytest.fixture(scope="module")
def starts(cache):
    """What a first and a second start of a session told, and compiled by themselves."""
    runs = [
        subprocess.run(
            [sys.executable, "-c", FIRST_START, scene("demo")],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
            timeout=LONGEST_COMPILATION_S,
        )
        for _ in range(2)
    ]
    return [json.loads(run.stdout) for run in runs]


def test_a_session_finds_its_kernels_compiled_by_processes_beside_each_other(starts):
    (told, compiled), again = starts
    assert len(told) == 1
    assert told[0].startswith("compiling the numerics, at the first start only")
    assert compiled == []
    assert again == [[], []]


@pytest.mark.usefixtures("starts")
def test_a_session_begins_when_the_process_that_models_has_compiled_its_own(cache, tmp_path):
    assert not list(cache.rglob("bottom_up.*.nbi"))
    variables = {"NUMBA_CACHE_DIR": str(cache)}
    arguments = (scene("demo"), "--json-lines", "--port", 0)
    with Service("leader", *arguments, cwd=tmp_path, **variables) as leader:
        leader.wait_for(lambda: leader.lines("ready"), LONGEST_COMPILATION_S)
        with follower_of(leader, "demo", tmp_path) as follower:
            leader.wait_for(lambda: any(status["samples"] for status in leader.lines("status")))
            leader.signal(signal.SIGTERM)
            assert (leader.end(), follower.end()) == (0, 0)
    assert list(cache.rglob("bottom_up.*.nbi"))
    texture = leader.summary()["texture"]
    assert texture["dropped_frames"] == texture["late_frames"] == 0
