"""Every stage of the bench at a size of seconds: what it must find on any machine."""

import json

import pytest

from mmt.evaluation.figures import to_png
from mmt_lab.bench import signals
from mmt_lab.experiments import (
    burg,
    conceal,
    contact,
    interpolation,
    lines,
    order,
    pipeline,
    synthesis,
    update,
)
from mmt_lab.harness.findings import LeftOut
from mmt_lab.harness.plots import panels_figure

PLANS = {
    "burg": (
        burg,
        burg.Plan(
            orders=(4, 8),
            order=4,
            lengths=(60, 100),
            batch=(3, 80),
            rounds=2,
            offsets=(1.0, 1e4),
            stiff=tuple(c for c in signals.STIFF_CASES if len(c.signal) < 20 or "zero" in c.name),
        ),
    ),
    "lines": (
        lines,
        lines.Plan(
            orders=(6, 16),
            low_pass_orders=(8, 30),
            distances=(0.1, 0.001),
            batch=4,
            looked_at=2,
            rounds=2,
        ),
    ),
    "interpolation": (
        interpolation,
        interpolation.Plan(
            surfaces=("mesh",), counts=(10, 60), table_count=60, order=8, draws=1, rounds=2
        ),
    ),
    "synthesis": (
        synthesis,
        synthesis.Plan(
            samples=15,
            order=8,
            renewals=(1, 10),
            duration_s=3.0,
            timed_samples=400,
            calls=300,
            rounds=2,
        ),
    ),
    "update": (
        update,
        update.Plan(
            counts=(10, 40, 160), seconds=3, first_second=1, repeats=1, calls=100, rounds=2
        ),
    ),
    "order": (
        order,
        order.Plan(
            surfaces=("wood",),
            duration_s=6.0,
            orders=(4, 12),
            periods_s=(1.0, 2.0),
            moments_s=(5.0, 6.0),
            rounds=1,
        ),
    ),
    "pipeline": (
        pipeline,
        pipeline.Plan(
            surfaces=("wood",),
            duration_s=6.0,
            moments_s=(0.5, 4.0, 6.0),
            periods_s=(1.0, 2.0),
            rounds=1,
        ),
    ),
    "conceal": (
        conceal,
        conceal.Plan(
            surfaces=("wood",), duration_s=8.0, gaps=(5, 20), compared=(5, 20), timed_gaps=20
        ),
    ),
    "contact": (
        contact,
        contact.Plan(
            stiffnesses_n_m=(5_000.0,),
            ticks=10,
            divisions=(1, 4, 16),
            tolerances=(1e-4,),
            reference=1e-9,
            rounds=1,
        ),
    ),
}


@pytest.fixture(scope="module")
def results():
    return {name: module.measure(plan) for name, (module, plan) in PLANS.items()}


def errors(panel, method):
    return {point.knob: point.y.median for point in panel.points(method)}


@pytest.mark.parametrize("name", PLANS)
def test_a_stage_has_panels_that_can_be_drawn_and_written(results, name):
    result = results[name]
    assert result.panels
    for panel in result.panels:
        for curve in panel.curves:
            for point in curve.points:
                assert point.x.low <= point.x.median <= point.x.high
                assert point.x.median > 0
                assert point.y.median >= 0
    assert json.loads(json.dumps(result.as_dict(), allow_nan=False))["title"] == result.title
    assert to_png(panels_figure(result)).startswith(b"\x89PNG")


def test_burg_is_exact_and_holds_where_it_is_stiff(results):
    result = results["burg"]
    for panel in result.panels:
        assert max(errors(panel, "mmt").values()) < 1e-13
    stiff = next(records for records in result.records if records.name == "stiff")
    ours = [row for row in stiff.rows if row["method"] == "mmt"]
    assert len(ours) == 2
    assert all(row["stable"] for row in ours)
    held = next(target for target in result.targets if "mmt holds" in target.what)
    assert held.met


def test_peers_are_measured_or_left_out(results):
    for name, peers in (
        ("burg", ("librosa", "memspectrum", "spectrum", "statsmodels")),
        ("lines", ("pysptk", "spectrum")),
    ):
        methods = " ".join(curve.method for curve in results[name].panels[0].curves)
        left_out = {out.name for out in results[name].left_out}
        for peer in peers:
            assert (peer in methods) != (peer in left_out)


def test_frequencies_from_reflection_coefficients_keep_their_digits(results):
    result = results["lines"]
    panels = {panel.name: panel for panel in result.panels}
    for panel in panels.values():
        assert all(error < 1e-13 for error in errors(panel, lines.OURS).values())
    through = errors(panels["low_pass"], lines.OURS_AR)
    assert through[30] > 1000 * errors(panels["low_pass"], lines.OURS)[30]
    back = next(target for target in result.targets if "back" in target.what)
    assert back.met
    accuracy = next(target for target in result.targets if "low-pass" in target.what)
    assert accuracy.met


def test_more_samples_interpolate_better_and_the_field_knows_the_power_best(results):
    shape, level = results["interpolation"].panels
    for method in ("field", "published"):
        at = errors(shape, method)
        assert at[60] < at[10]
    at_60 = {curve.method: errors(level, curve.method)[60] for curve in level.curves}
    assert at_60["field"] < at_60["published"]
    rows = results["interpolation"].records[0].rows
    floor = next(row for row in rows if row["method"] == interpolation.FLOOR)
    assert floor["power error (dB)"] < 1e-6


def test_a_rarer_renewal_changes_more(results):
    result = results["synthesis"]
    for method in (synthesis.OURS, synthesis.SCIPY):
        at = errors(result.panels[0], method)
        assert at[1] == 0.0
        assert 0.0 < at[10] < 0.5
    assert any(isinstance(out, LeftOut) for out in result.left_out) or any(
        curve.method == synthesis.C for curve in result.panels[0].curves
    )


def test_the_update_and_rendering_are_measured_at_every_size(results):
    stages, calls = results["update"].panels
    names = {curve.method for curve in stages.curves}
    assert {"filter", "segment", "fit", "triangulate", "completion", update.WHOLE} == names
    for panel in (stages, calls):
        for curve in panel.curves:
            assert [point.knob for point in curve.points] == [10, 40, 160]
    assert len(results["update"].targets) == 4


def test_a_higher_order_costs_no_power_error(results):
    _, level = results["order"].panels
    at = errors(level, "period 1 s")
    assert at[4] == pytest.approx(at[12], rel=0.1)  # but for the share below 8 Hz


def test_before_the_first_model_nothing_is_right(results):
    panels = {panel.name: panel for panel in results["pipeline"].panels}
    for method in pipeline.METHODS:
        curve = f"{method}, every 1 s"
        assert errors(panels["gfc_session"], curve)[0.5] == 1.0
        assert errors(panels["jnd_session"], curve)[0.5] == 0.0
        assert errors(panels["gfc_session"], curve)[6.0] < 0.1
    spent = panels["gfc_processing"].points("field, every 1 s")
    assert [point.knob for point in spent] == [4.0, 6.0]
    assert spent[0].x.median < spent[1].x.median


def test_each_row_of_the_pipeline_has_an_error_and_what_an_update_costs(results):
    (record,) = results["pipeline"].records
    kinds = [(row["method"], row["update every (s)"]) for row in record.rows]
    assert kinds == [(method, period) for method in pipeline.METHODS for period in (1.0, 2.0)]
    for row in record.rows:
        assert 0.0 <= row["power error (dB)"] < 6.0
        assert 0.0 < row["an update (ms)"] <= row["longest update (ms)"] <= row["processing (ms)"]


def test_the_exact_step_agrees_with_the_general_solver(results):
    panel = results["contact"].panels[0]
    assert max(errors(panel, "exact with events").values()) < 1e-7
    for method in ("explicit Euler", "semi-implicit Euler", "discrete gradient"):
        at = errors(panel, method)
        assert at[1000.0 / 16] < at[1000.0]
    assert errors(panel, contact.RADAU)[1e-4] < 1e-2


def test_a_model_conceals_gaps_better_than_silence(results):
    result = results["conceal"]
    spectrum, alone, step = result.panels
    for gap in (5, 20):
        of = {curve.method: errors(spectrum, curve.method)[gap] for curve in spectrum.curves}
        assert of[conceal.MODEL] < of[conceal.SILENCE]
        assert 0.0 < errors(alone, conceal.MODEL)[gap] < 0.1
        assert errors(step, conceal.MODEL)[gap] < 1.0
    assert [row[""] for row in result.records[0].rows] == [
        conceal.MODEL,
        conceal.BACKWARDS,
        conceal.SILENCE,
    ]
