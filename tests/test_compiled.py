import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mmt.core.compiled import kernel
from mmt.core.kernel_cache import (
    KERNELS,
    compile_kernels,
    drop_stale_kernels,
    kernels_are_compiled,
)

SMALL_SCENE = """
[rendering]
model = "oak"
[hand]
[actuator]
"""

FIRST_START = """
import json, sys
from pathlib import Path
from mmt.core.kernel_cache import compile_kernels
from mmt.leader.part import Session
from mmt.leader.parts import build_parts, numerics_of
from mmt.scene.files import load_scene

scene, told, compiled = load_scene(Path(sys.argv[1])), [], []
compile_kernels(numerics_of(scene), told.append)
compile_kernels(numerics_of(scene), told.append)

from numba.core.dispatcher import Dispatcher
whole = Dispatcher.compile

def compile_noted(self, signature):
    entry = whole(self, signature)
    if self.py_func.__module__.startswith("mmt") and not self.stats.cache_hits:
        compiled.append(self.py_func.__qualname__)
    return entry

Dispatcher.compile = compile_noted
build_parts(Session(scene))
print(json.dumps([told, compiled]))
"""
"""Compile what a scene needs, then load its parts and tell what had to be compiled all the same."""


def test_a_kernel_needs_a_signature() -> None:
    with pytest.raises(ValueError, match="signature"):
        kernel()


def test_kernels_are_dropped_when_any_source_of_their_folder_changes(tmp_path: Path) -> None:
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


def test_what_was_imported_is_compiled() -> None:
    import mmt.texture.interpolation.delaunay  # noqa: F401

    assert kernels_are_compiled()


def test_a_scene_finds_all_its_kernels_compiled_by_processes_beside_each_other(
    tmp_path: Path,
) -> None:
    """In a copy of the package, so that no kernel is cached beside its source."""
    shutil.copytree(KERNELS.parent, tmp_path / "mmt", ignore=shutil.ignore_patterns("*.nb[ci]"))
    (tmp_path / "scene.toml").write_text(SMALL_SCENE)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    run = [sys.executable, "-c", FIRST_START, tmp_path / "scene.toml"]
    ended = subprocess.run(
        run, check=True, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=150
    )
    told, compiled = json.loads(ended.stdout)
    assert told == ["compiling the numerics, at the first start only (10 to 20 s)"]
    assert compiled == []
    assert list((tmp_path / "mmt").rglob("*.nbi"))


def test_where_nothing_can_be_written_beside_the_sources_nothing_is_compiled_beforehand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """numba caches elsewhere then, and every start would compile, for all that is known here."""
    monkeypatch.setattr("mmt.core.kernel_cache.kernels_are_compiled", lambda: False)
    monkeypatch.setattr("mmt.core.kernel_cache._PROGRAM", "raise SystemExit")
    told: list[str] = []
    compile_kernels([], told.append)
    assert len(told) == 1
    monkeypatch.setattr(os, "access", lambda *_: False)
    compile_kernels([], told.append)
    assert len(told) == 1


def test_a_report_imports_no_kernels_of_the_selection_which_it_does_not_show() -> None:
    program = "import sys, mmt.cli.reporting, mmt.evaluation.figures; print(*sys.modules)"
    ended = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=150
    )
    assert "mmt.evaluation.report" in ended.stdout.split()
    assert "mmt.texture.selection" not in ended.stdout.split()
