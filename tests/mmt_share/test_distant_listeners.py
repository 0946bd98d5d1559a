"""Listeners behind a network, and those that make trouble, as the experiment has them."""

import asyncio
import gc
import socket
from collections import Counter

import numpy as np
import pytest
from sharing_samples import listening, model_of, shared, until

from mmt.evaluation.levels import BAND_EDGES_HZ, band_errors_db
from mmt_lab.sharing import felt
from mmt_lab.sharing.felt import STEP_NS, errors_db, listen, pairs, states
from mmt_lab.sharing.memory import Memory
from mmt_lab.sharing.troubled import STEADY, Troubled

INPUTS = np.array([[50.0, 0.5], [150.0, 1.5], [250.0, 2.5]])


def test_moments_are_counted_by_what_both_render() -> None:
    operator = [(0, 1), (4 * STEP_NS, 2)]
    listener = [(2 * STEP_NS, 1), (5 * STEP_NS, 2)]
    times = range(-STEP_NS, 7 * STEP_NS, STEP_NS)
    assert states(operator, times) == [0, 1, 1, 1, 1, 2, 2, 2]
    assert states(listener, times) == [0, 0, 0, 1, 1, 1, 2, 2]
    assert pairs(operator, listener, 9 * STEP_NS) == {(1, 1): 2, (2, 1): 1, (2, 2): 4}
    assert pairs(operator, [], 10 * STEP_NS) == Counter()


def test_the_error_is_that_of_the_spectra_by_bands() -> None:
    models = {1: model_of(6), 2: model_of(40)}
    found = errors_db(models, INPUTS, {(1, 1): 3, (2, 1): 2, (7, 1): 4})
    frequencies = np.arange(BAND_EDGES_HZ[0], BAND_EDGES_HZ[-1] + 1.0)
    old, new = (models[n].spectrum(*INPUTS.T, frequencies_hz=frequencies) for n in (1, 2))
    expected = np.sqrt(np.mean(band_errors_db(old, new, frequencies) ** 2))
    assert expected > 0.1
    np.testing.assert_allclose(found, [0.0, 0.0, 0.0, expected, expected])


async def test_listeners_behind_a_network_are_compared_with_the_one_here(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(felt, "STEP_NS", 5_000_000)  # a delay is longer than that
    async with shared() as sharing:
        finding = asyncio.create_task(listen(sharing.url, 2, 30.0, "wan"))
        await until(lambda: len(sharing.relay.listeners) == 3)
        for count in (6, 40):
            sharing.publish(count)
            for k in range(5):
                state = 0.1 * count + 0.01 * k
                sharing.offer_state(state, force_n=1.0, speed_mm_s=100.0)
                await asyncio.sleep(0.1)
        sharing.relay.finish("completed")
        found = await finding
    assert (found["listeners"], found["behind_at_end"]) == (2, 0)
    assert (found["wholes"], found["changes"]) == (2, 2)
    assert min(found["lags_ms"]) >= 30.0
    errors = np.array(found["errors_db"])
    assert 0.0 < found["same_share"] < 1.0
    delayed = np.array(found["delay_errors_db"])
    for each in (errors, delayed):
        assert len(each) > 5
        assert each.max() > 0.0
        assert (each == 0.0).mean() > 0.3


async def test_troubles_disturb_nobody() -> None:
    async with shared() as sharing, listening(sharing.url) as heard:
        sharing.publish(10)
        troubled = Troubled(sharing.url, 1)
        running = asyncio.create_task(troubled.run(60.0))
        await until(lambda: len(sharing.relay.listeners) >= STEADY + 1)
        await asyncio.gather(*map(troubled.make, ("rubbish", "visits", "vanished")))
        sharing.publish(11)
        await until(lambda: heard.models[-1:] == [2])
        await asyncio.sleep(0.5)
        sharing.relay.finish("completed")
        found = await running
        assert heard.client.rejected == 0
    assert found["steady"] == STEADY
    assert all(found[kind] >= 1 for kind in ("rubbish", "visits", "vanished"))


@pytest.mark.parametrize("slope_mb_h", [0.0, 60.0])
def test_memory_that_grows_is_told(slope_mb_h: float) -> None:
    memory = Memory()
    rng = np.random.default_rng(3)
    for second in range(600):
        noise_mb = 0.1 * rng.standard_normal()
        memory.add("leader", float(second), 190.0 + slope_mb_h / 3600.0 * second + noise_mb)
    grown = memory.growth("leader")
    assert grown.growth is not None
    assert 3600.0 * grown.growth / grown.span_s == pytest.approx(slope_mb_h, abs=2.0)
    assert grown.least_growth is not None
    assert (grown.least_growth > 1.0) == (slope_mb_h > 0.0)
    assert memory.growth("sharing").typical is None


async def test_trouble_for_nobody_leaves_no_session_open(caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        await Troubled(f"http://127.0.0.1:{nobody.getsockname()[1]}", 1).make("rubbish")
    gc.collect()
    assert "Unclosed" not in caplog.text
