import pytest

from mmt.cli.benching import run_benches
from mmt.errors import InputError


def test_an_unknown_measurement_is_explained() -> None:
    with pytest.raises(InputError, match="allowed are link, services, evaluate"):
        run_benches(["speed"], 1.0)


def test_the_evaluation_is_measured() -> None:
    tables, figures = run_benches(["evaluate"], 1.0)
    assert len(tables) == 1
    assert figures["evaluate"]["median_s"] > 0
    assert figures["evaluate"]["times_real_time"] == pytest.approx(
        18.0 / figures["evaluate"]["median_s"]
    )


def test_the_link_is_measured_beside_a_bare_websocket() -> None:
    _, figures = run_benches(["link"], 1.5)
    assert figures["link"]["up_lost"] == 0
    assert figures["link"]["ratio_up_p50"] > 0
