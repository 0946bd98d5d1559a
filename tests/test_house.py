"""What the project measures of itself is what is there."""

import runpy
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[1] / "scripts" / "house"


@pytest.fixture(scope="module")
def house():
    return runpy.run_path(str(HOUSE))


@pytest.fixture
def project(tmp_path):
    package = tmp_path / "src" / "mmt"
    for folder in (package / "core", tmp_path / "tests", tmp_path / "docs"):
        folder.mkdir(parents=True)
    wide = ", ".join(f"p{number}" for number in range(9))
    (package / "__init__.py").write_text('"""A product."""\n')
    (package / "core" / "one.py").write_text(
        f'class Twice:\n    """Two, where there are two."""\n\n\ndef wide({wide}):\n    _ = p0\n'
        f"\n\n@kernel('f8(f8)')\ndef compiled({wide}):\n    return p0\n"
    )
    (package / "core" / "two.py").write_text(
        "class Twice:\n    def __init__(self):\n        self._own = 1\n\n\nclass _Hidden: ...\n"
    )
    (package / "core" / "page.js").write_text("let a;\nlet b;\n")
    (tmp_path / "tests" / "test_it.py").write_text(
        "import os\nfrom mmt.core.two import _Hidden\n\n\ndef test(it):\n    it._own = os._exit\n"
    )
    (tmp_path / "docs" / "index.md").write_text("three plain words\n")
    (tmp_path / "README.md").write_text("two words\n")
    return tmp_path


def test_sizes_are_counted_and_what_is_hard_to_read_is_named(house, project):
    found = house["sizes"](project) | house["names"](project)
    counted = {"mmt": {"files": 3, "lines": 18}, "mmt.core": {"files": 2, "lines": 17}}
    assert found["packages"] == counted
    assert found["javascript"] == {"files": 1, "lines": 2}
    assert found["fullest_folders"] == {"src/mmt/core": 2, "src/mmt": 1}
    assert (found["pages"], found["words_of_docs"], found["words_of_readme"]) == (1, 3, 2)
    assert (found["public_classes"], found["in_several_modules"]) == (1, ["Twice"])
    assert found["many_positional_parameters"] == ["src/mmt/core/one.py:5 wide"]
    assert found["where_for_if"] == 1


def test_tests_use_few_private_names_of_the_product(house, project):
    uses = house["private_uses"]
    assert uses(project) == ["tests/test_it.py:2 _Hidden", "tests/test_it.py:6 _own"]
    assert len(uses(HOUSE.parents[1])) <= 30


def test_what_a_run_loads_and_calls_is_known(house):
    found = house["run"](HOUSE.parents[1], house["MODELLING"], "trace")
    assert any("segmentation" in each for each in found["modelling"]["calls"])
    called = [each for each in found["leader"]["calls"] if "segmenting" in each]
    assert called
    assert set(called) <= set(found["leader"]["loaded"])
    assert not any("segmentation" in each for each in found["follower"]["loaded"])


def test_a_run_that_fails_says_why(house):
    with pytest.raises(SystemExit, match=r"leader of the run failed:\nerror: .*no_such_table"):
        house["run"](HOUSE.parents[1], house["STREAMING"] + "[no_such_table]\n", "run")
