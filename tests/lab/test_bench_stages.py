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
from mmt_lab.harness.findings import SkippedMethod
from mmt_lab.harness.plots import panels_figure

SMALL = {
    burg: {
        "ORDERS": (4, 8),
        "ORDER": 4,
        "LENGTHS": (60, 100),
        "BATCH": (3, 80),
        "ROUNDS": 2,
        "OFFSETS": (1.0, 1e4),
        "STIFF": [c for c in signals.STIFF_CASES if len(c.signal) < 20 or "zero" in c.name],
    },
    lines: {
        "ORDERS": (6, 16),
        "LOW_PASS_ORDERS": (8, 30),
        "DISTANCES": (0.1, 0.001),
        "BATCH": 4,
        "LOOKED_AT": 2,
        "ROUNDS": 2,
    },
    interpolation: {
        "SURFACES": ("mesh",),
        "COUNTS": (10, 60),
        "TABLE_COUNT": 60,
        "ORDER": 8,
        "DRAWS": 1,
        "ROUNDS": 2,
    },
    synthesis: {
        "SAMPLES": 15,
        "ORDER": 8,
        "RENEWALS": (1, 10),
        "DURATION_S": 3.0,
        "TIMED_SAMPLES": 400,
        "CALLS": 300,
        "ROUNDS": 2,
    },
    update: {
        "COUNTS": (10, 40, 160),
        "SECONDS": 3,
        "FIRST_SECOND": 1,
        "REPEATS": 1,
        "CALLS": 100,
        "ROUNDS": 2,
    },
    order: {
        "SURFACES": ("wood",),
        "DURATION_S": 6.0,
        "ORDERS": (4, 12),
        "PERIODS_S": (1.0, 2.0),
        "MOMENTS_S": (5.0, 6.0),
        "ROUNDS": 1,
    },
    pipeline: {
        "SURFACES": ("wood",),
        "DURATION_S": 6.0,
        "MOMENTS_S": (0.5, 4.0, 6.0),
        "PERIODS_S": (1.0, 2.0),
        "ROUNDS": 1,
        "RATES_KHZ": (1, 10),
    },
    conceal: {
        "SURFACES": ("wood",),
        "DURATION_S": 8.0,
        "GAPS": (5, 20),
        "COMPARED": (5, 20),
        "TIMED_GAPS": 20,
    },
    contact: {
        "STIFFNESSES_N_M": (5_000.0,),
        "TICKS": 10,
        "DIVISIONS": (1, 4, 16),
        "TOLERANCES": (1e-4,),
        "REFERENCE": 1e-9,
        "ROUNDS": 1,
    },
}
STAGES = [module.__name__.rpartition(".")[2] for module in SMALL]


@pytest.fixture(scope="module")
def results():
    found = {}
    for name, (module, sizes) in zip(STAGES, SMALL.items(), strict=True):
        with pytest.MonkeyPatch.context() as patch:
            for size, value in sizes.items():
                patch.setattr(module, size, value)
            found[name] = module.run()
    return found


def errors(panel, method):
    return {point.knob: point.y.median for point in panel.points(method)}


@pytest.mark.parametrize("name", STAGES)
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
    assert any(isinstance(out, SkippedMethod) for out in result.left_out) or any(
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
    record, rates = results["pipeline"].records
    kinds = [(row["method"], row["update every (s)"]) for row in record.rows]
    assert kinds == [(method, period) for method in pipeline.METHODS for period in (1.0, 2.0)]
    for row in record.rows:
        assert 0.0 <= row["power error (dB)"] < 6.0
        assert 0.0 < row["an update (ms)"] <= row["longest update (ms)"] <= row["processing (ms)"]
    orders = {row["acceleration (kHz)"]: row["order"] for row in rates.rows}
    assert orders == {1: 16, 10: 64}
    assert all(row["a second rendered (ms)"] > 0.0 for row in rates.rows)


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
