import ast
import json
import pickle
import sys
from pathlib import Path

import pytest
from numba.core import caching
from python_programs import printed_by

from mmt.core.compiled import (
    are_cached,
    collect_kernels,
    compile_collected,
    drop_stale_kernels,
    kernel,
)
from mmt.core.errors import MmtError
from mmt.core.kernel_cache import compile_kernels
from mmt.texture.model.texture_model import load_model

SAVED_MODEL = '[rendering]\nmodel = "oak"\n[hand]\n[actuator]\n'

MODELLING = "[link]\n[simulated]\n[hand]\n[playout]\n[actuator]\n[texture]\n[rendering]\n"
DRIVER = """[actuator]
driver = "haptuator-serial"
port = "/dev/none"
full_scale_v = 3.0
volts_per_m_s2 = 0.1
"""
DRIVEN = MODELLING.replace("[actuator]\n", DRIVER)

ASKED_FOR = """
import json, pickle, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from mmt.core.kernel_cache import compile_kernels
from mmt.leader.part import Session
from mmt.leader.parts import build_parts, numerics_of
from mmt.scene.files import load_scene

whole, names = Dispatcher.compile, []

def compile_noted(self, signature):
    names.append(self.py_func.__qualname__)
    return whole(self, signature)

Dispatcher.compile = compile_noted
scene = load_scene(Path(sys.argv[1]))
compile_kernels(numerics_of(scene), lambda _: None)
asked = len(names)
parts = build_parts(Session(scene))
parts.completing._tell_of_skin(pickle.loads(Path(sys.argv[2]).read_bytes()))
print(json.dumps([asked, names[asked:]]))
"""
"""Ask for a scene's kernels, load its parts, have them judge a model, and tell what these needed
beside."""

DOUBLED = """
from mmt.core.compiled import kernel

@kernel("f8(f8)")
def doubled(x):
    return 2.0 * x
"""


INNER = """
from mmt.core.compiled import kernel

@kernel("f8(f8)", inner=True)
def halved(x):
    return 0.5 * x

@kernel("f8(f8)")
def quartered(x):
    return halved(halved(x))
"""

INNER_FROM_CACHE = """
import sys
from mmt.core.compiled import are_cached, collect_kernels, compile_collected

kernels = collect_kernels(["inner_numerics"])
was_cached = are_cached(kernels)
compile_collected(kernels)
from inner_numerics import halved, quartered
print(was_cached, len(halved.signatures), quartered(3.0), halved(3.0))
"""


def test_a_kernel_needs_a_signature_and_a_folder_to_be_kept_in(monkeypatch):
    with pytest.raises(ValueError, match="signature"):
        kernel()
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    with pytest.raises(MmtError, match="NUMBA_CACHE_DIR"):
        kernel("f8(f8)")(lambda x: x)


def test_kernels_are_dropped_when_any_source_of_their_folder_changes(tmp_path):
    source = tmp_path / "numerics.py"
    source.write_text("one")
    assert drop_stale_kernels(tmp_path)
    compiled = tmp_path / "__pycache__" / "other.nbi"
    compiled.touch()
    assert not drop_stale_kernels(tmp_path)
    assert compiled.exists()
    source.write_text("two")
    assert drop_stale_kernels(tmp_path)
    assert not compiled.exists()


def test_kernels_that_are_collected_are_compiled_when_they_are_asked_for(tmp_path, monkeypatch):
    (tmp_path / "doubled_numerics.py").write_text(DOUBLED)
    monkeypatch.syspath_prepend(tmp_path)
    kernels = collect_kernels(["doubled_numerics"])
    (doubled,) = kernels
    assert not are_cached(kernels)
    assert not doubled.signatures
    compile_collected(kernels)
    assert are_cached(kernels)
    assert doubled(3.0) == 6.0
    assert collect_kernels(["doubled_numerics"]) == {}


def test_an_inner_kernel_is_loaded_for_callers_that_are_not_cached(tmp_path):
    (tmp_path / "inner_numerics.py").write_text(INNER)
    (tmp_path / "run.py").write_text(INNER_FROM_CACHE)
    found = [printed_by(tmp_path / "run.py").split() for _ in range(2)]
    assert found == [["False", "1", "0.75", "1.5"], ["True", "0", "0.75", "1.5"]]


def _kernels_and_callers():
    """Return the kernels of the sources, and whether inner, and all names that Python reads."""
    kernels = {}
    read = set()

    def visit(node):
        for child in ast.iter_child_nodes(node):
            decorators = getattr(child, "decorator_list", [])
            calls = [each for each in decorators if isinstance(each, ast.Call)]
            found = [each for each in calls if getattr(each.func, "id", "") == "kernel"]
            if found:
                assert isinstance(child, ast.FunctionDef)
                kernels[child.name] = any(word.arg == "inner" for word in found[0].keywords)
                continue
            if isinstance(child, ast.Name):
                read.add(child.id)
            visit(child)

    for source in (Path(__file__).parents[1] / "src").rglob("*.py"):
        visit(ast.parse(source.read_text()))
    return kernels, read


def test_kernels_that_only_kernels_call_are_inner():
    kernels, read = _kernels_and_callers()
    assert len(kernels) > 50
    assert {name for name, inner in kernels.items() if inner} == kernels.keys() - read


@pytest.mark.parametrize(
    "scene", [SAVED_MODEL, MODELLING, DRIVEN], ids=["saved model", "modelling", "driven"]
)
def test_a_scene_asks_for_every_kernel_that_it_uses(tmp_path, scene):
    (tmp_path / "scene.toml").write_text(scene)
    (tmp_path / "model").write_bytes(pickle.dumps(load_model("oak").prepared()))
    printed = printed_by("-c", ASKED_FOR, tmp_path / "scene.toml", tmp_path / "model")
    asked, loaded_later = json.loads(printed)
    assert asked > 5
    assert loaded_later == []


def test_kernels_are_compiled_in_the_program_where_the_processes_fail(tmp_path, monkeypatch):
    (tmp_path / "failing_numerics.py").write_text(DOUBLED)
    monkeypatch.syspath_prepend(tmp_path)  # where the processes do not look
    told = []
    compile_kernels(["failing_numerics"], told.append)
    assert len(told) == 1
    assert sys.modules["failing_numerics"].doubled(3.0) == 6.0
