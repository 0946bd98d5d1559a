"""A model at another sampling rate: the same spectra and levels, in the common band."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.models import shipped_models
from mmt.texture.autoregression.forms import lsf_to_reflection, reflection_to_lsf
from mmt.texture.field.cells import FieldCells
from mmt.texture.model.texture_model import TextureModel, load_model
from mmt.texture.settings import usual_order
from mmt.texture.space import TextureSamples
from mmt.texture.synthesis.synthesizer import Synthesizer

COMMON_HZ = np.arange(10.0, 490.0, 2.0)
SPEEDS_MM_S, FORCES_N = (each.ravel() for each in np.meshgrid([40.0, 110.0, 220.0], [0.6, 1.8]))


def error_db(one, other):
    """The root mean square over frequency of the difference of spectra."""
    densities = (
        model.spectrum(SPEEDS_MM_S, FORCES_N, frequencies_hz=COMMON_HZ) for model in (one, other)
    )
    return np.sqrt(np.mean(np.square(10.0 * np.log10(np.divide(*densities))), axis=1))


@pytest.mark.parametrize("name", list(shipped_models()))
def test_shipped_models_keep_their_spectra_at_other_rates(name):
    model = load_model(name)
    for rate_hz, most_db in ((2000.0, 0.9), (5000.0, 1.0), (10_000.0, 1.8)):
        other = model.at_rate(rate_hz)
        assert other.rate_hz == rate_hz
        assert other.order == usual_order(rate_hz)
        assert error_db(model, other).max() < most_db
        back = other.at_rate(1000.0)
        assert back.order == usual_order(1000.0)
        assert error_db(model, back).max() < most_db
        apart_db = (
            back.level_db(SPEEDS_MM_S, FORCES_N)[0] - model.level_db(SPEEDS_MM_S, FORCES_N)[0]
        )
        assert np.abs(apart_db).max() < 0.2


def test_at_its_own_rate_a_model_is_itself():
    model = load_model("oak")
    assert model.at_rate(1000.0) is model
    with pytest.raises(InputError, match="rate_hz"):
        model.at_rate(0.0)


@settings(max_examples=30)
@given(
    st.lists(st.floats(-0.9999, 0.9999), min_size=1, max_size=64),
    st.sampled_from([500.0, 1000.0, 2000.0, 10_000.0]),
    st.sampled_from([500.0, 1000.0, 5000.0, 10_000.0]),
)
def test_whatever_the_filter_it_stays_stable_and_its_power_falls_at_most(
    values, before_hz, rate_hz
):
    lsf = reflection_to_lsf(np.array([values]))
    samples = TextureSamples.isotropic(
        np.array([100.0]), np.ones(1), lsf, np.zeros(1), np.full(1, 2.0)
    )
    other = TextureModel(samples, rate_hz=before_hz, method="published").at_rate(rate_hz)
    assert (np.diff(other.samples.lsf, prepend=0.0, append=np.pi) > 0.0).all()
    assert 0.0 <= other.samples.power[0] <= 2.0
    assert rate_hz < before_hz or other.samples.power[0] == 2.0
    found = Synthesizer(other, seed=1).render(np.full(300, 100.0), np.ones(300))
    assert np.isfinite(found).all()


def test_only_the_power_within_the_band_goes_down_in_samples_and_blocks():
    inputs = np.array([[60.0, 0.5], [200.0, 2.0]])
    slow, fast = np.array([[-0.99, 0.9]]), np.array([[0.9, 0.5]])  # most power below, and above
    lsf = reflection_to_lsf(np.vstack([slow, fast]))
    samples = TextureSamples(inputs, lsf, np.ones(2), np.full(2, 3.0), noise_power=0.1)
    cells = FieldCells.from_blocks(samples.points, np.full(2, 3.0), np.array([0, 10]))
    other = TextureModel(samples, field=cells, rate_hz=10_000.0).at_rate(1000.0)
    left = other.samples.power / 3.0
    assert left[0] > 0.9
    assert left[1] < 0.1
    np.testing.assert_allclose(other.field.sums[:, 1], cells.sums[:, 1] * left, rtol=1e-12)
    np.testing.assert_allclose(other.field.sums[:, 2], cells.sums[:, 2] + np.log(left), rtol=1e-9)
    assert other.samples.noise_power == pytest.approx(0.01)
    reflection = lsf_to_reflection(np.array(other.samples.lsf))
    np.testing.assert_allclose(
        other.samples.variance, other.samples.power * np.prod(1 - reflection**2, axis=1), rtol=1e-6
    )
