"""What the project measures of itself is what is there."""

import runpy
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[1] / "scripts" / "house"


@pytest.fixture(scope="module")
def house():
    return runpy.run_path(str(HOUSE))


def test_tests_use_few_private_names_of_the_product(house):
    assert 0 < len(house["private_uses"](HOUSE.parents[1])) <= 30


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
