"""Difficult cases: what holds, that a fault would be seen, and how both are told."""

import dataclasses
import json
import math

import numpy as np
import pytest
from command_runs import run, run_json
from extreme_cases import case_of, those_that_do_not_hold
from spectrum import arburg

from mmt.core.errors import InputError
from mmt.texture.autoregression.burg import ReflectionFits, burg
from mmt.texture.field import posterior
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.experiments import stability
from mmt_lab.experiments.stability import findings_of, load_families
from mmt_lab.harness.report import write_report
from mmt_lab.stability import loop_theory
from mmt_lab.stability.families import (
    CaseResult,
    Extreme,
    Family,
    anisotropic,
    ar,
    broken,
    contact,
    family_names,
    field,
    loop,
    lsf,
    model,
    networks,
    run_case,
)
from mmt_lab.stability.families.ar import exact_burg, exact_residual
from mmt_lab.stability.families.loop import run_loop
from mmt_lab.stability.integrators import INTEGRATORS
from mmt_lab.stability.loop_theory import LIGHT_GRIP, critical_delay_s


@pytest.mark.parametrize("order", [1, 4, 13])
def test_the_reference_is_burgs_method(order):
    x = np.random.default_rng(order).standard_normal(80)
    reflection, residual = exact_burg(x, order)
    _, _, expected = arburg(x, order)
    np.testing.assert_allclose([float(k) for k in reflection], np.real(expected), atol=1e-12)
    assert float(residual - exact_residual(x, [float(k) for k in reflection])) < 1e-12
    assert float(exact_residual(x, [])) == pytest.approx(np.mean(x**2), rel=1e-14)


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


def test_contact_holds():
    cases = contact.cases(stiffnesses=(1e4, 1e7), map_points=6)
    assert those_that_do_not_hold("contact", cases) == []


def test_what_is_wrongly_offered_as_safe_does_not_hold(monkeypatch):
    praised = dataclasses.replace(INTEGRATORS["semi-implicit Euler"], safe=True)
    monkeypatch.setattr(contact, "INTEGRATORS", {praised.name: praised})
    impacts = contact.cases(stiffnesses=(1e5,))[0]
    assert "semi-implicit" in impacts.what
    assert not impacts.run().held


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_a_theory_that_is_off_does_not_hold(factor, monkeypatch):
    true = INTEGRATORS["explicit Euler"]
    off = dataclasses.replace(true, limit_s=lambda d, w: factor * true.limit_s(d, w))
    monkeypatch.setattr(contact, "INTEGRATORS", {off.name: off})
    limits = next(c for c in contact.cases(stiffnesses=(1e4,)) if "sustained" in c.what)
    assert not limits.run().held


def test_a_soft_wall_is_stable_for_every_delay():
    assert math.isinf(critical_delay_s(0.2))
    assert run_loop(0.2, 100, 100, 4.0) < 1.0


def test_the_loop_holds():
    cases = loop.cases(
        walls_n_mm=(0.2, 1.0, 10.0),
        delays_ms=(0, 5, 50),
        method_walls_n_mm=(50.0,),
        method_delays_ms=(100,),
    )
    assert those_that_do_not_hold("loop", cases) == []


def test_another_theory_does_not_hold(monkeypatch):
    firm = dataclasses.replace(LIGHT_GRIP, stiffness_n_m=450.0)
    monkeypatch.setattr(loop_theory, "LIGHT_GRIP", firm)
    cases = loop.cases(walls_n_mm=(1.0,), delays_ms=(13, 50))
    assert not cases[0].run().held
    assert not cases[-1].run().held


def row(*, held=True, **figures):
    case = Extreme("a thing is done", "it holds", lambda: CaseResult("it did", held, figures))
    return run_case("model", case)


def fault():
    message = "no luck"
    raise ArithmeticError(message)


def test_a_case_that_raises_has_not_held():
    found = run_case("ar", Extreme("divide", "a number", fault))
    assert not found.held
    assert found.got == "raised ArithmeticError: no luck"
    assert broken([row(), found]) == [found]


def test_a_row_can_be_read_by_a_program():
    figures = {"none": math.inf, "some": np.float64(2.5), "many": [np.int64(3), math.nan]}
    rows = [row(held=np.bool_(True), **figures)]
    (found,) = json.loads(json.dumps(findings_of(rows).as_dict()))["rows"]
    assert found["held"] is True
    assert found["figures"] == {"none": None, "some": 2.5, "many": [3, None]}


def test_families_are_found_by_name_and_unknown_ones_are_refused():
    assert list(load_families(["model", "ar"])) == ["ar", "model"]
    assert list(load_families()) == family_names()
    with pytest.raises(InputError, match="allowed are anisotropic, ar, contact"):
        load_families(["ar", "texture"])


def test_a_report_holds_every_row_and_both_pictures(tmp_path):
    cases = {
        "contact": [contact.cases(stiffnesses=(1e4,), map_points=4)[-1]],
        "model": [Extreme("bad", "good", lambda: CaseResult("worse", held=False))],
    }
    rows = [run_case(name, case) for name, some in cases.items() for case in some]
    page = write_report(tmp_path / "report", findings_of(rows))
    text = page.read_text(encoding="utf-8")
    assert "data:image/png" in text
    assert "worse" in (tmp_path / "report" / "report.md").read_text(encoding="utf-8")
    assert (tmp_path / "report" / "figures" / "contact.png").stat().st_size > 1000
    found = json.loads((tmp_path / "report" / "summary.json").read_text(encoding="utf-8"))
    assert found["held"] is False
    assert found["not_held"] == ["bad"]


def test_the_command_prints_families_and_says_by_its_code_whether_all_held(tmp_path, monkeypatch):
    few = model.cases(many=50, queries=10)[:3]
    monkeypatch.setattr(stability, "load_family", lambda _: Family("Few models", lambda: few))
    figures, result = run_json(tmp_path, "stability", "model")
    assert "Few models" in result.output
    assert figures["cases"] == 3
    few.append(Extreme("a broken thing", "holds", lambda: CaseResult("does not", held=False)))
    result = run("stability", "model", "--report", tmp_path / "report")
    assert result.exit_code == 1
    assert "a broken thing" in result.output
    assert (tmp_path / "report" / "report.html").exists()
