import asyncio
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mmt.core.running.ticking
from mmt.core.running.ending import cancel_until_ended
from mmt.core.running.ticking import Ticker, TickStatistics, TimeHistogram

PERIOD_NS = 1_000_000


@pytest.fixture(params=["timerfd", "call_at"])
def clock(request, monkeypatch):
    if request.param == "call_at":
        monkeypatch.setattr(mmt.core.running.ticking, "open_timer", lambda: None)
    elif mmt.core.running.ticking.open_timer() is None:
        pytest.skip("this system has no timerfd")
    return str(request.param)


async def test_ticks_follow_the_clock_and_do_not_drift(clock):
    elapsed = []

    def tick(ticks):
        elapsed.append(ticks)
        if sum(elapsed) >= 200:
            ticker.stop()

    ticker = Ticker(PERIOD_NS, tick)
    start_s = time.monotonic()
    ticker.start()
    await ticker.wait()
    assert time.monotonic() - start_s >= 0.2
    assert min(elapsed) >= 1
    statistics = ticker.statistics
    # every period that passed was handed over, whatever the machine was doing
    assert statistics.ticks == sum(elapsed)
    assert statistics.missed == sum(elapsed) - len(elapsed)
    assert 0.5 < statistics.period_p50_ms < 5.0


async def test_a_held_up_loop_gets_its_missed_ticks_with_the_next(clock):
    elapsed = []
    ticker = Ticker(PERIOD_NS, elapsed.append)
    start_ns = time.monotonic_ns()
    ticker.start()
    await asyncio.sleep(0.005)
    time.sleep(0.05)
    await asyncio.sleep(0.005)
    passed = (time.monotonic_ns() - start_ns) // PERIOD_NS
    ticker.stop()
    assert max(elapsed) >= 48
    assert sum(elapsed) <= passed
    statistics = ticker.statistics
    assert statistics.missed >= 47
    assert 45 / sum(elapsed) < statistics.late_share_1ms <= 1.0


async def test_what_the_callback_raises_stops_the_ticker_and_comes_out_of_wait(clock):
    calls = []

    def fail(elapsed):
        calls.append(elapsed)
        raise ZeroDivisionError("in the tick")

    ticker = Ticker(PERIOD_NS, fail)
    ticker.start()
    with pytest.raises(ZeroDivisionError, match="in the tick"):
        await ticker.wait()
    assert not ticker.running
    await asyncio.sleep(0.01)
    assert len(calls) == 1


async def test_a_callback_that_runs_out_of_data_is_an_error_like_any_other():
    ticker = Ticker(PERIOD_NS, lambda elapsed: next(iter(())))
    ticker.start()
    with pytest.raises(RuntimeError, match="StopIteration"):
        await ticker.wait()


async def test_a_waiter_that_gives_up_does_not_swallow_the_error():
    fail = asyncio.Event()

    def tick(elapsed):
        if fail.is_set():
            raise ZeroDivisionError

    ticker = Ticker(PERIOD_NS, tick)
    ticker.start()
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(ticker.wait(), 0.01)
    assert ticker.running
    fail.set()
    with pytest.raises(ZeroDivisionError):
        await ticker.wait()


async def test_stop_ends_the_ticks_and_may_be_repeated(clock):
    elapsed = []
    ticker = Ticker(PERIOD_NS, elapsed.append)
    ticker.stop()
    assert not ticker.running
    ticker.start()
    assert ticker.running
    await asyncio.sleep(0.01)
    ticker.stop()
    ticker.stop()
    await ticker.wait()
    count = len(elapsed)
    await asyncio.sleep(0.01)
    assert len(elapsed) == count > 0


async def test_a_ticker_is_used_once_and_in_order_and_has_a_period():
    ticker = Ticker(PERIOD_NS, lambda elapsed: None)
    with pytest.raises(RuntimeError, match="not started"):
        await ticker.wait()
    ticker.start()
    with pytest.raises(RuntimeError, match="once"):
        ticker.start()
    ticker.stop()
    with pytest.raises(RuntimeError, match="once"):
        ticker.start()
    for period_ns in (0, -1):
        with pytest.raises(ValueError, match="period_ns"):
            Ticker(period_ns, lambda elapsed: None)


async def test_without_statistics_only_the_ticks_are_counted():
    ticker = Ticker(PERIOD_NS, lambda elapsed: ticker.stop(), statistics=False)
    assert ticker.statistics == TickStatistics(0, 0, None, None, None)
    ticker.start()
    await ticker.wait()
    statistics = ticker.statistics
    assert statistics.ticks >= 1
    assert statistics.period_p50_ms is statistics.late_share_1ms is None


async def test_no_file_stays_open():
    timer = mmt.core.running.ticking.open_timer()
    if timer is None:
        pytest.skip("this system has no timerfd")
    first = timer.file
    timer.close()
    for _ in range(20):
        ticker = Ticker(PERIOD_NS, lambda elapsed: None)
        ticker.start()
        ticker.stop()
    timer = mmt.core.running.ticking.open_timer()
    assert timer.file == first
    timer.close()


@given(
    st.lists(st.integers(0, 2**40 - 1), min_size=1, max_size=200),
    st.floats(0.0, 1.0, allow_nan=False),
)
@settings(max_examples=100)
def test_quantiles_agree_with_those_of_all_values(values, fraction):
    histogram = TimeHistogram()
    for value in values:
        histogram.add(value)
    assert histogram.count == len(values)
    quantile_ns = histogram.quantile_ns(fraction)
    # it lies in the bin, 0.8 % wide, of the value at that rank or of a neighbour in rank
    ranked = np.sort(np.array(values, dtype=np.float64))
    rank = fraction * len(values)
    low = ranked[max(int(np.ceil(rank)) - 1, 0)]
    assert low * (1 - 1 / 128) - 1 <= quantile_ns <= low * (1 + 1 / 128) + 1


def test_the_histogram_takes_what_lies_beyond_its_range():
    histogram = TimeHistogram()
    assert histogram.quantile_ns(0.5) is None
    assert histogram.quantile_ms(0.99) is None
    for duration_ns in (-5, 0, 2**60):
        histogram.add(duration_ns)
    assert histogram.quantile_ns(0.0) == 0.0
    assert histogram.quantile_ns(1.0) == pytest.approx(2**40, rel=0.01)
    within = TimeHistogram()
    for duration_ns in range(1_000_000, 1_004_000, 10):
        within.add(duration_ns)
    assert within.quantile_ms(0.5) == pytest.approx(1.002, abs=0.003)
    for fraction in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="fraction"):
            histogram.quantile_ns(fraction)


async def test_a_task_that_swallows_a_cancellation_is_asked_again():
    swallowed = []

    async def stubborn():
        while len(swallowed) < 2:
            try:
                await asyncio.sleep(3600.0)
            except asyncio.CancelledError as cancellation:
                swallowed.append(cancellation)
        raise swallowed[-1]

    async def failed():
        raise ValueError("its own")

    tasks = [asyncio.ensure_future(stubborn()), asyncio.ensure_future(failed())]
    await asyncio.sleep(0)
    async with asyncio.timeout(10.0):
        await cancel_until_ended(tasks)
    assert len(swallowed) == 2
    assert all(task.done() for task in tasks)
    await cancel_until_ended([])
