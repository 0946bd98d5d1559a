import itertools
import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from mmt.link.emulated.impairments import MessageImpairments
from mmt.scene import PROFILES, Network

MS = 1_000_000
START_NS = 7 * MS

TABLES = st.fixed_dictionaries(
    {
        "delay_ms": st.floats(0.0, 1000.0),
        "reorder": st.booleans(),
        "loss": st.floats(0.0, 0.5),
        "burst_messages": st.floats(1.0, 1e5),
        "burst_loss": st.floats(0.5, 1.0),
        "duplicate": st.floats(0.0, 1.0),
        "bandwidth_kbit_s": st.none() | st.floats(1.0, 1e5),
        "jitter_time_ms": st.just(0.0) | st.floats(1e-3, 60_000.0),
    },
    optional={"outage_s": st.floats(0.0, 9.0)},
)
GAPS_NS = st.lists(st.integers(0, 10**9), min_size=1, max_size=60)


def fates(count=20_000, seed=1, size=100, period_ns=MS, **table):
    """The delays (ns) of messages that are sent at an even rate."""
    model = MessageImpairments(Network(**table), seed, START_NS)
    times = [START_NS + index * period_ns for index in range(count)]
    return [tuple(at - sent for at in model.arrivals_ns(sent, size)) for sent in times]


def delays_ms(given):
    return np.array([fate[0] / MS for fate in given if fate])


def lost(given):
    return np.array([not fate for fate in given])


@settings(max_examples=150)
@given(TABLES, GAPS_NS, st.integers(0, 2**63 - 1), st.floats(0.0, 1.0), st.integers(0, 131_072))
def test_nothing_arrives_early_or_overtakes_or_comes_more_than_twice(
    table, gaps_ns, seed, jitter_share, size
):
    table["jitter_ms"] = jitter_share * table["delay_ms"]
    network = Network(**table)
    model = MessageImpairments(network, seed, START_NS)
    again = MessageImpairments(network, seed, START_NS)
    least_ns = (network.delay_ms - network.jitter_ms) * MS
    arrivals = []
    for sent_ns in itertools.accumulate(gaps_ns, initial=START_NS):
        fate = model.arrivals_ns(sent_ns, size)
        assert fate == again.arrivals_ns(sent_ns, size)
        assert len(fate) <= 2
        assert all(at >= sent_ns + least_ns - 1 for at in fate)
        arrivals += fate
    if not network.reorder:
        assert arrivals == sorted(arrivals)


@pytest.mark.parametrize("time_ms", [0.0, 20.0])
def test_delays_are_spread_evenly_within_the_jitter(time_ms):
    given = delays_ms(
        fates(60_000, delay_ms=40, jitter_ms=10, jitter_time_ms=time_ms, reorder=True)
    )
    assert given.min() >= 30.0
    assert given.max() <= 50.0
    for share in (0.1, 0.25, 0.5, 0.75, 0.9):
        assert np.quantile(given, share) == pytest.approx(30 + 20 * share, abs=0.9)


def test_slow_jitter_is_correlated_as_it_says():
    given = delays_ms(fates(60_000, delay_ms=40, jitter_ms=10, jitter_time_ms=20, reorder=True))
    # back through the normal distribution's quantiles by ranks: the process is Gaussian there
    ranks = (np.argsort(np.argsort(given)) + 0.5) / len(given)
    normal = np.array([NormalDist().inv_cdf(rank) for rank in ranks[:40_000]])
    normal -= normal.mean()
    for lag in (5, 20, 40):
        expected = (1 + lag / 20) * math.exp(-lag / 20)
        measured = np.mean(normal[lag:] * normal[:-lag]) / np.mean(normal**2)
        assert measured == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(
    ("loss", "burst", "burst_loss"), [(0.02, 10, 1.0), (0.1, 1, 1.0), (0.1, 30, 0.5), (0.7, 5, 1.0)]
)
def test_loss_and_bursts_have_the_wanted_means(loss, burst, burst_loss):
    gone = lost(fates(80_000, loss=loss, burst_messages=burst, burst_loss=burst_loss))
    assert gone.mean() == pytest.approx(loss, rel=0.2)
    if burst_loss == 1.0:
        runs = [len(list(run)) for is_lost, run in itertools.groupby(gone) if is_lost]
        expected = max(burst, 1 / (1 - loss))
        assert np.mean(runs) == pytest.approx(expected, rel=0.2)
        # geometric lengths: the standard deviation follows from the mean
        assert np.std(runs) == pytest.approx(math.sqrt(expected * (expected - 1)), rel=0.3)
    if burst == 1:  # losses of their own
        assert abs(np.corrcoef(gone[1:], gone[:-1])[0, 1]) < 0.02


@settings(max_examples=50)
@given(
    st.floats(0.0, 200.0),
    st.floats(0.0, 0.5),
    st.floats(1.0, 50.0),
    st.sampled_from([0.0, 20.0]),
    st.integers(0, 2**32),
)
def test_what_is_sent_again_arrives_in_order_and_none_is_lost(
    delay_ms, loss, burst, jitter_time_ms, seed
):
    table = {"delay_ms": delay_ms, "jitter_ms": delay_ms / 2, "jitter_time_ms": jitter_time_ms}
    given = fates(2000, seed, **table, loss=loss, burst_messages=burst, retransmit=True)
    assert all(len(fate) == 1 for fate in given)
    arrivals = np.array([fate[0] for fate in given]) + MS * np.arange(2000)
    assert (np.diff(arrivals) >= 0).all()
    assert delays_ms(given).min() >= delay_ms / 2 - 1e-6


def test_a_lost_message_holds_up_those_behind_it_as_tcp_does():
    """One in a thousand: all wait until a round trip and 3 ms later, or twice as long."""
    given = delays_ms(fates(100_000, delay_ms=40.0, loss=0.001, retransmit=True))
    assert np.median(given) == 40.0
    begins = np.flatnonzero(np.diff(given) > 50.0) + 1
    assert 60 < len(begins) < 140
    assert set(np.round(given[begins], 6)) <= {123.0, 206.0, 289.0}
    assert np.mean(given[begins] == 123.0) > 0.95
    first = begins[0]
    np.testing.assert_allclose(given[first : first + 80], 123.0 - np.arange(80))


def test_nothing_everything_or_what_the_seed_chooses_is_lost():
    assert fates(1000) == fates(1000, loss=0.0, burst_messages=50) == [(0,)] * 1000
    assert lost(fates(1000, loss=1.0)).all()
    assert fates(500, seed=1, profile="bad") != fates(500, seed=2, profile="bad")


def test_duplicates_come_behind_the_first_with_a_delay_of_their_own():
    given = fates(20_000, duplicate=0.25, delay_ms=5, jitter_ms=5, reorder=True)
    twice = [fate for fate in given if len(fate) == 2]
    assert len(twice) / len(given) == pytest.approx(0.25, abs=0.02)
    assert sum(first != second for first, second in twice) > 0.99 * len(twice)


def test_the_bandwidth_spaces_messages_and_the_full_queue_loses_them():
    # 100 bytes take 2 ms at 400 kbit/s, and one is sent each millisecond
    given = fates(2000, bandwidth_kbit_s=400, queue_ms=50)
    model_ms = delays_ms(given[:40])
    np.testing.assert_allclose(model_ms, 2.0 + np.arange(40))
    assert lost(given[200:]).mean() == pytest.approx(0.5, abs=0.01)
    assert delays_ms(given).max() <= 52.0


def test_an_outage_ends_each_interval():
    gone = lost(fates(10_000, outage_s=0.5, outage_every_s=2.0))
    assert np.array_equal(gone, np.arange(10_000) % 2000 >= 1500)


def test_messages_after_a_change_do_not_overtake_those_before():
    before = MessageImpairments(Network(delay_ms=500), 1, 0)
    (late_ns,) = before.arrivals_ns(0, 10)
    after = MessageImpairments(Network(), 1, MS)
    after.continue_from(before)
    assert after.arrivals_ns(MS, 10) == (late_ns,)
    assert after.arrivals_ns(600 * MS, 10) == (600 * MS,)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_fills_in_what_is_not_given(profile):
    network = Network.model_validate({"profile": profile, "loss": 0.5})
    expected = {**PROFILES[profile], "loss": 0.5}
    assert {key: getattr(network, key) for key in expected} == expected
    assert Network.model_validate(network.model_dump()) == network


@pytest.mark.parametrize(
    ("profile", "least", "middle", "most"),
    [("wifi", 1.0, 3.0, 5.0), ("wan", 30.0, 40.0, 50.0), ("bad", 90.0, 150.0, 210.0)],
)
def test_the_profiles_have_the_delays_that_their_names_promise(profile, least, middle, most):
    given = delays_ms(fates(40_000, profile=profile))
    width = most - least
    assert given.min() == pytest.approx(least, abs=0.02 * width)
    assert np.median(given) == pytest.approx(middle, abs=0.08 * width)
    assert given.max() == pytest.approx(most, abs=0.02 * width)


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"delay_ms": 1, "jitter_ms": 2}, "must not exceed delay_ms"),
        ({"loss": 0.6, "burst_loss": 0.5}, "must not exceed burst_loss"),
        ({"outage_s": 20}, "must not exceed outage_every_s"),
        ({"retransmit": True, "reorder": True}, "leave out reorder"),
        ({"retransmit": True, "loss": 0.6}, "lower loss"),
        ({"profile": "moon"}, "profile"),
        ({"profile": ["lan"]}, "profile"),
        ({"delay_ms": math.nan}, "delay_ms"),
        ({"speed": 1}, "speed"),
    ],
)
def test_what_cannot_be_emulated_is_refused(table, problem):
    with pytest.raises(ValidationError, match=problem):
        Network(**table)
