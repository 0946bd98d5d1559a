import numpy as np
import pytest
from selection_samples import sampled_texture

from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem
from mmt.texture.selection import select_published
from mmt.texture.selection.leave_one_out import retrained
from mmt.texture.selection.network import NetworkNeighbours, network

SETTINGS = [
    RadialBasisSettings("linear", 1),
    RadialBasisSettings("thin_plate_spline", 1),
    RadialBasisSettings("cubic", 1, smoothing=0.01),
]


def solved_anew(points, values, present, index, settings):
    others = present.copy()
    others[index] = False
    system = RadialBasisSystem(points[others], values[others], settings)
    return system.network().at(points[index : index + 1])[0]


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: f"{s.kernel}")
@pytest.mark.parametrize("dimensions", [2, 3])
def test_what_is_left_out_in_closed_form_is_what_solving_anew_gives(settings, dimensions):
    generator = np.random.default_rng(1)
    points = generator.random((40, dimensions))
    points[3] = points[7]  # two samples at one place are one centre
    values = np.sin(3.0 * points) @ generator.normal(size=(dimensions, 4))
    values += 0.1 * generator.normal(size=values.shape)
    present = generator.random(40) < 0.9
    present[[3, 7]] = True
    model = NetworkNeighbours(points, values, present, settings)
    for leaving, joining in ((5, 6), (11, 12), (7, 20)):
        for index, change, now in ((leaving, model.remove, False), (joining, model.add, True)):
            if present[index] != now:
                change(index)
                present[index] = now
        for index in range(40):
            expected = solved_anew(points, values, present, index, settings)
            np.testing.assert_allclose(model.predict(index), expected, atol=1e-7)


def test_a_sample_without_which_the_polynomial_is_not_told_has_no_prediction():
    points = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.5, 1.0]])
    model = NetworkNeighbours(points, points, np.ones(4, bool), RadialBasisSettings("linear", 1))
    assert model.predict(3) is None


def test_the_published_decisions_by_a_network_are_those_of_training_it_for_every_point():
    data, _ = sampled_texture(60, 3, knocks=6, seed=3)
    settings = RadialBasisSettings("linear", 1)

    def train(points, values):
        return RadialBasisSystem(points, values, settings).network().at

    fast = select_published(data, interpolator=network(settings))
    slow = select_published(data, interpolator=retrained(train))
    np.testing.assert_array_equal(fast.outlier, slow.outlier)
    np.testing.assert_array_equal(fast.kept, slow.kept)
    np.testing.assert_allclose(fast.error, slow.error, rtol=1e-6)
