"""Energies that come late, twice, not at all, or of a sender that began anew."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.contact.energies import EnergyCounts, EnergyReport
from mmt.core.frames import ENERGY_DTYPE


def record(x, y=0.0, z=0.0):
    records = np.zeros(1, dtype=ENERGY_DTYPE)
    records["energy_j"][0] = (x, y, z)
    return records


@given(st.lists(st.tuples(st.floats(-1.0, 10.0), st.booleans()), max_size=50))
def test_what_is_known_never_falls(news):
    counts = EnergyCounts()
    before = counts.energy_j
    for energy, restarts in news:
        if restarts:
            counts.restart()
        counts.receive(record(energy))
        assert counts.energy_j[0] >= before[0]
        before = counts.energy_j


def test_one_who_began_anew_is_counted_on_from_what_was_known():
    counts = EnergyCounts()
    for energy in (5.0, 7.0, 6.0):  # before this side began, after it, and late
        counts.receive(record(energy))
    assert counts.energy_j[0] == 2.0
    counts.restart()
    counts.receive(record(0.5))
    assert counts.energy_j[0] == 2.5
    counts.restart()
    counts.receive(record(0.75))  # the same one, connected again
    assert counts.energy_j[0] == 2.75


def test_it_speaks_when_there_is_news_and_now_and_then_again():
    report = EnergyReport()
    assert report.make((0.0, 0.0, 0.0), 1000) is None
    first = report.make((0.0, 0.0, 1.0), 1, 7)
    assert first["energy_j"][0].tolist() == [0.0, 0.0, 1.0]
    assert first["time_ns"][0] == 7
    assert [report.make((0.0, 0.0, 1.0), 50) is None for _ in range(2)] == [True, False]
    assert report.make((0.0, 0.0, 1.1), 1)["sequence"][0] == 2


def test_the_numbers_start_again_before_they_do_not_fit(monkeypatch):
    monkeypatch.setattr("mmt.contact.energies.SEQUENCES", 2, raising=False)
    report = EnergyReport()
    records = [report.make((float(energy), 0.0, 0.0), 1) for energy in range(1, 5)]
    assert [int(record["sequence"][0]) for record in records] == [0, 1, 0, 1]


def test_an_opening_is_known_before_anything_comes():
    assert EnergyCounts(0.1).energy_j == pytest.approx((0.1, 0.1, 0.1))
