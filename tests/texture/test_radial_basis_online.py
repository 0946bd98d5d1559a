"""Samples that come and go: the same network as solved at once, at a lower cost."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem

QUERIES = {d: np.random.default_rng(9).random((40, d)) for d in (2, 3)}


def anew(system: RadialBasisSystem) -> RadialBasisSystem:
    """Solve for the same centres at once; those of several samples by as many equal ones."""
    table = system._table
    repeated = table.counts.astype(int)
    return RadialBasisSystem(
        np.repeat(table.points, repeated, axis=0),
        np.repeat(table.values, repeated, axis=0),
        system.settings,
    )


def assert_same(system: RadialBasisSystem, tolerance: float) -> None:
    other, dimensions = anew(system), system.centres.shape[1]
    queries = QUERIES[dimensions]
    np.testing.assert_allclose(
        system.network().at(queries), other.network().at(queries), rtol=0, atol=tolerance
    )
    assert system.degree == other.degree


@pytest.mark.parametrize(
    "chosen",
    [
        RadialBasisSettings("linear", 0),
        RadialBasisSettings("thin_plate_spline", 1, smoothing=1e-3),
        RadialBasisSettings("cubic", 1),
        RadialBasisSettings("quintic", 2),
        RadialBasisSettings("multiquadric", 0, 4.0, 1e-3),
        RadialBasisSettings("gaussian", -1, 6.0),
    ],
    ids=lambda chosen: chosen.kernel,
)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_long_sequence_ends_where_one_solution_does(chosen, dimensions):
    generator = np.random.default_rng(3)
    rotation = generator.standard_normal((dimensions, 3))
    system = RadialBasisSystem(*_samples(generator, 20, rotation), chosen)
    handles = list(range(20))
    for step in range(600):
        if step % 3 == 2 or len(handles) > 120:
            system.remove(handles.pop(int(generator.integers(len(handles)))))
        else:
            points, values = _samples(generator, 1, rotation)
            handles.append(system.add(points[0], values[0]))
    assert sorted(h for of in system.handles for h in of) == sorted(handles)
    assert_same(system, 1e-7)
    expected = anew(system).leave_one_out()
    np.testing.assert_allclose(system.leave_one_out(), expected, rtol=1e-4, atol=1e-6)
    assert system.solutions < 20  # of 600 changes


def _samples(generator, count, rotation):
    points = generator.random((count, len(rotation)))
    return points, np.sin(3.0 * points @ rotation)


@given(
    chosen=st.sampled_from(
        [
            RadialBasisSettings("linear", 2),
            RadialBasisSettings("thin_plate_spline", 2, smoothing=1e-2),
            RadialBasisSettings("multiquadric", 1, 5.0, 1e-2),
        ]
    ),
    steps=st.lists(
        st.tuples(st.booleans(), st.integers(0, 4), st.integers(0, 4), st.integers(0, 2)),
        max_size=40,
    ),
)
@settings(max_examples=25, deadline=None)
def test_repeated_and_aligned_samples_come_and_go(chosen, steps):
    """Points of a small grid: coincident, collinear and coplanar ones, down to one sample."""
    system = RadialBasisSystem(np.full((1, 3), 0.5), np.ones((1, 2)), chosen)
    handles = [0]
    for index, (removes, *place) in enumerate(steps):
        if removes and len(handles) > 1:
            system.remove(handles.pop(place[0] * 7 % len(handles)))
        else:
            point = np.array(place) / 4.0
            handles.append(system.add(point, np.array([np.cos(index), np.sin(index)])))
    assert_same(system, 1e-5)


def test_rounding_is_noticed_and_made_good():
    generator = np.random.default_rng(1)
    points, values = _samples(generator, 80, generator.standard_normal((2, 2)))
    system = RadialBasisSystem(points, values, RadialBasisSettings("cubic", 1))
    size = system._size
    for relative, solutions in ((1e-13, 1), (1e-2, 2)):  # refined, and solved anew
        noise = generator.standard_normal((size, size))
        system._inverse[:size, :size] *= 1.0 + relative * (noise + noise.T)
        system._solution[:size] *= 1.0 + 1e-5
        system.remove(system.add(np.array([0.5, 0.5]), np.zeros(2)))
        assert system.solutions == solutions
        np.testing.assert_allclose(system.network().at(points), values, atol=1e-8)


def test_a_sample_beside_another_is_met_with_a_little_smoothing():
    generator = np.random.default_rng(1)
    points, values = _samples(generator, 60, generator.standard_normal((2, 2)))
    system = RadialBasisSystem(points, values, RadialBasisSettings("quintic", 2))
    system.add(points[0] + 3e-6, values[0] + 1.0)
    at = system.network().at(np.vstack([points[1:], QUERIES[2]]))
    assert np.isfinite(at).all()
    assert len(system.centres) == 61


def test_adding_costs_less_than_solving_the_more_samples_there_are():
    ratios = []
    for count in (100, 500):
        generator = np.random.default_rng(count)
        rotation = generator.standard_normal((3, 17))
        points, values = _samples(generator, count + 9, rotation)
        system = RadialBasisSystem(points[:count], values[:count], RadialBasisSettings("cubic", 1))
        adding = []
        for point, value in zip(points[count:], values[count:], strict=True):
            started = time.process_time()
            system.add(point, value)
            adding.append(time.process_time() - started)
        started = time.process_time()
        RadialBasisSystem(points, values, system.settings)
        ratios.append((time.process_time() - started) / np.median(adding))
    assert ratios[1] > 3.0
    assert system.solutions == 1


def test_values_may_be_replaced():
    generator = np.random.default_rng(5)
    points, values = _samples(generator, 60, generator.standard_normal((3, 2)))
    points[9] = points[4]
    system = RadialBasisSystem(points, values, RadialBasisSettings("cubic", 1, smoothing=1e-3))
    system.replace({index: np.cos(value) for index, value in enumerate(values)})
    other = RadialBasisSystem(points, np.cos(values), system.settings)
    np.testing.assert_allclose(
        system.network().at(QUERIES[3]), other.network().at(QUERIES[3]), atol=1e-12
    )
    assert system.solutions == 1


@pytest.mark.parametrize("kernel", ["gaussian", "multiquadric", "inverse_multiquadric"])
def test_a_function_that_is_all_but_constant_is_smoothed_by_what_it_was_rounded_by(kernel):
    generator = np.random.default_rng(2)
    points, values = generator.random((60, 3)), generator.standard_normal((60, 2))
    system = RadialBasisSystem(points, values, RadialBasisSettings(kernel, 0, 1e-3))
    network = system.network()
    assert 0.0 < network.settings.smoothing < 1e-8
    off = values - network.at(points) - network.settings.smoothing * network.weights
    assert np.abs(off).max() < 1e-13 * np.abs(network.weights).max()
    handle = system.add(np.full(3, 0.5), np.zeros(2))
    system.remove(handle)
    assert np.isfinite(system.network().at(points)).all()
