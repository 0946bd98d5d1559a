"""The loops in C do the work of the kernels that they are compared with."""

import numpy as np
import pytest

from mmt.testing.simulation.textures import get_surface
from mmt.texture.autoregression.forms import burg_batch, lsf_to_ar
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.bench import c_loops
from mmt_lab.bench.textures import exact_samples, scattered
from mmt_lab.harness.findings import SkippedMethod


@pytest.fixture(scope="module")
def loops():
    with c_loops.compiled() as found:
        if isinstance(found, SkippedMethod):
            pytest.skip(f"no C loops: {found.reason}")
        yield found


def test_burg(loops):
    segments = [np.random.default_rng(n).standard_normal(n) for n in (30, 201, 64)]
    expected = burg_batch(segments, 12)
    stops = np.cumsum([len(segment) for segment in segments])
    reflection, variances = np.empty((3, 12)), np.empty((3, 13))
    loops.burg_call(np.concatenate(segments), stops, reflection, variances)()
    np.testing.assert_allclose(reflection, expected.reflection, atol=1e-13)
    np.testing.assert_allclose(variances, expected.variances, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 9, 16])
def test_back_to_coefficients(loops, order):
    lsf = np.sort(np.random.default_rng(order).uniform(0.01, 3.1, (4, order)))
    ar = np.empty_like(lsf)
    loops.lsf_to_ar_call(lsf, ar)()
    expected = lsf_to_ar(lsf)
    np.testing.assert_allclose(ar, expected, atol=1e-12 * np.abs(expected).max())


def test_rendering(loops):
    seed, count = 3, 2000
    model = TextureModel(
        exact_samples(get_surface("wood"), *scattered(20, 0), 10), method="published"
    )
    phase = np.arange(count) / 150.0
    motion = 150.0 + 120.0 * np.sin(phase), 1.5 + 1.2 * np.cos(1.3 * phase)
    expected = Synthesizer(model, seed=seed, renewal_samples=5).render(*motion)
    generator = np.random.default_rng(seed)
    generator.standard_normal(64)  # the synthesizer's first memory
    output = np.empty(count)
    loops.render_call(model, motion, 5, generator.standard_normal(count), output)()
    # The memory starts empty here; what it held there has faded.
    np.testing.assert_allclose(output[1500:], expected[1500:], atol=1e-8)
    assert np.abs(output[1500:]).max() > 0.1


def test_without_a_compiler_it_is_left_out(monkeypatch):
    monkeypatch.setenv("CC", "/nowhere/cc")
    with c_loops.compiled() as found:
        assert isinstance(found, SkippedMethod)
        assert "no C compiler" in found.reason


def test_a_compiler_that_fails_is_left_out(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with c_loops.compiled() as found:
        assert isinstance(found, SkippedMethod)
        assert "failed" in found.reason
