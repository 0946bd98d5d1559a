"""Fits, line spectral frequencies and models: what holds, and that a fault would be seen."""

from decimal import Decimal

import numpy as np
import pytest
from extreme_cases import case_of, those_that_do_not_hold
from spectrum import arburg

from mmt.texture.autoregression.burg import ReflectionFits, burg
from mmt.texture.field import posterior
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.stability.families import anisotropic, ar, field, lsf, model, networks
from mmt_lab.stability.families.ar import exact_burg, exact_residual


@pytest.mark.parametrize("order", [1, 4, 13])
def test_the_reference_is_burgs_method(order):
    x = np.random.default_rng(order).standard_normal(80)
    reflection, residual = exact_burg(x, order)
    _, _, expected = arburg(x, order)
    np.testing.assert_allclose([float(k) for k in reflection], np.real(expected), atol=1e-12)
    assert float(residual - exact_residual(x, [float(k) for k in reflection])) < 1e-12
    assert float(exact_residual(x, [])) == pytest.approx(np.mean(x**2), rel=1e-14)


def test_the_reference_has_the_digits_that_the_stiff_cases_need():
    n = np.arange(300)
    x = np.ldexp(np.round(np.ldexp(np.cos(0.01 * n), 40)), -40)
    _, residual = exact_burg(x, 6)
    scaled, same = exact_burg(np.ldexp(x, -900), 6)
    assert same * Decimal(2) ** 1800 == pytest.approx(residual, rel=Decimal("1e-100"))
    assert all(abs(k) < 1 for k in scaled)


@pytest.mark.parametrize(
    ("name", "cases"),
    [
        ("ar", ar.cases()),
        ("field", field.cases(many=5000)),
        ("anisotropic", anisotropic.cases(many=200, queries=200)),
        ("networks", networks.cases(samples=30)),
    ],
)
def test_a_family_that_times_nothing_holds(name, cases):
    assert those_that_do_not_hold(name, cases) == []


def test_a_fit_that_loses_digits_does_not_hold(monkeypatch):
    def rounded(x, order):
        fit = burg(x, order)
        return ReflectionFits(fit.reflection.astype(np.float16).astype(np.float64), fit.variances)

    cases = ar.cases()
    stiff = case_of(cases, "radius 0.99, clustered")
    monkeypatch.setattr(ar, "burg", rounded)
    assert not stiff.run().held
    assert case_of(cases, "white noise, order 8").run().held


def test_a_fit_that_is_not_stable_does_not_hold(monkeypatch):
    def unstable(x, order):
        fit = burg(x, order)
        return ReflectionFits(1.5 * np.sign(fit.reflection), fit.variances)

    monkeypatch.setattr(ar, "burg", unstable)
    outcome = case_of(ar.cases(), "order 8").run()
    assert not outcome.held
    assert "not stable" in outcome.got


def test_line_spectral_frequencies_hold():
    cases = lsf.cases(swaps=400_000, renders=60)
    timed = [case for case in cases if "strokes and pauses" in case.what or "swapped" in case.what]
    assert those_that_do_not_hold("lsf", [case for case in cases if case not in timed]) == []
    for case in timed:
        figures = case.run().figures
        settled = 0.3 if "stiff" in case.what else 0.05  # stiff filters ring for seconds
        assert abs(figures.get("power_error", 0.0)) < settled
        assert figures.get("peak", 0.0) < 8.0
        assert figures.get("heard_m_s2", 0.0) == 0.0


class GrowingVibration:
    """A filter that rings up while it is swapped."""

    def __init__(self, *_, **__):
        self._level = 1.0

    def render(self, speed_mm_s, force_n):
        self._level *= 2.0
        return self._level * np.ones(len(speed_mm_s))


def test_a_filter_that_rings_up_does_not_hold(monkeypatch):
    cases = lsf.cases(swaps=200_000, renders=20)
    monkeypatch.setattr(lsf, "Synthesizer", GrowingVibration)
    for words in ("ordinary filters", "pauses", "radius 0.999,"):
        assert not case_of(cases, words).run().held


def test_a_field_that_is_too_sure_does_not_hold(monkeypatch):
    observe = posterior.observe

    def sure(*given):
        found = observe(*given)
        return found._replace(variance=1e-6 * found.variance)

    monkeypatch.setattr(posterior, "observe", sure)
    assert not case_of(field.cases(), "bursts").run().held


def test_models_of_any_samples_hold():
    cases = model.cases(many=600, queries=500)
    growth = case_of(cases, "from 60 to 600")
    assert those_that_do_not_hold("model", [case for case in cases if case is not growth]) == []
    assert growth.run().figures["building_ratio"] > 0.0


@pytest.mark.parametrize(
    ("family", "words"), [(model, "3 samples"), (anisotropic, "60 of one heading")]
)
def test_inputs_with_a_hole_do_not_hold(family, words, monkeypatch):
    build = family.build

    def with_a_hole(*arguments):
        built = build(*arguments)
        built.triangulation.triangles[0] = built.triangulation.triangles[1]
        return built

    case = case_of(family.cases(many=100, queries=100), words)
    monkeypatch.setattr(family, "build", with_a_hole)
    assert not case.run().held


def test_a_vibration_at_rest_does_not_hold(monkeypatch):
    case = case_of(anisotropic.cases(many=100, queries=100), "30 at rest")
    at = TextureModel.at

    def with_a_floor(model, *inputs):
        lsf, variance = at(model, *inputs)
        return lsf, np.maximum(variance, 1e-12)

    monkeypatch.setattr(TextureModel, "at", with_a_floor)
    assert not case.run().held


def test_networks_that_miss_their_samples_do_not_hold(monkeypatch):
    at, cases = networks.RadialBasisNetwork.at, networks.cases(samples=30)
    monkeypatch.setattr(networks.RadialBasisNetwork, "at", lambda *_: at(*_) + 1e-4)
    assert not case_of(cases, "on a line").run().held
    monkeypatch.setattr(networks.RadialBasisNetwork, "at", at)
    monkeypatch.setattr(networks.NetworkNeighbours, "remove", lambda *_: None)
    assert not case_of(cases, "samples leave").run().held
