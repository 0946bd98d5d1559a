"""The documented part of the leader, from a package that the product does not know."""

import json
import os
import re
import tomllib
from pathlib import Path

import pytest
from plugin_samples import install_package
from python_programs import run_mmt
from service_processes import scene

PAGE = Path(__file__).parents[2] / "docs/how-to/add-a-leader-part.md"


def with_table(tmp_path, table):
    """The demo's scene, without a follower, with one more table."""
    file = tmp_path / "scene.toml"
    own = Path(scene("model-only"))
    text = own.read_text().replace('"models/', f'"{own.parent.as_posix()}/models/')
    file.write_text(f"{text}\n[loudness]\n{table}\n")
    return file


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    folder.mkdir()
    text = PAGE.read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    project = re.search(r"```toml\n(.*?)```", text, re.DOTALL)
    (folder / "my_package").mkdir()
    (folder / "my_package" / "loudness.py").write_text(code[1])
    entries = tomllib.loads(project[1])["project"]["entry-points"]
    install_package(folder, monkeypatch, "loudness-plugin", entries)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
    return folder


def test_it_runs_in_scenes_that_have_its_table(package, tmp_path):
    summary = tmp_path / "summary.json"
    scene_file = with_table(tmp_path, "digits = 2")
    found = run_mmt(tmp_path, "leader", scene_file, "--duration", 2, "--json", summary)
    assert found.returncode == 0, found.stderr
    largest = json.loads(summary.read_text())["loudness"]["largest_m_s2"]
    assert largest > 0.0
    assert largest == round(largest, 2)


@pytest.mark.parametrize(
    ("text", "table", "said"),
    [
        (None, "digits = 12", ("digits", "12")),
        ("raise OSError('no such board')", "", ("no such board",)),
        ("PART = 3", "", ("is no AddedPart",)),
        ("import math\nPART = math.pie", "", ("loudness.py, line 2)",)),
    ],
)
def test_a_wrong_table_or_part_is_told_of_where_it_is_wanted(package, tmp_path, text, table, said):
    if text is not None:
        (package / "my_package" / "loudness.py").write_text(text)
    found = run_mmt(tmp_path, "leader", with_table(tmp_path, table))
    assert found.returncode == 2
    told = " ".join(found.stderr.split())
    assert [words for words in said if words not in told] == []
    assert "Traceback" not in found.stderr
    assert run_mmt(tmp_path, "main", "--version").returncode == 0
