"""Every stage of the bench at a size of seconds: what it must find on any machine."""

import json

import pytest

from mmt.evaluation.reports.figures import stack_panels, to_png
from mmt_lab.bench import signals
from mmt_lab.experiments.bench import burg, lines, pipeline
from mmt_lab.harness.plots import panels_figure

SMALL = {
    burg: {
        "ORDERS": (4, 8),
        "LENGTH": 60,
        "BATCH": (3, 80),
        "ROUNDS": 2,
        "OFFSETS": (1.0, 1e4),
        "STIFF": [c for c in signals.STIFF_CASES if len(c.signal) < 20 or "zero" in c.name],
    },
    lines: {"ORDERS": (6, 16), "LOW_PASS_ORDERS": (8, 30), "BATCH": 4, "LOOKED_AT": 2, "ROUNDS": 2},
    pipeline: {
        "SURFACES": ("wood",),
        "DURATION_S": 6.0,
        "MOMENTS_S": (0.5, 4.0, 6.0),
        "PERIODS_S": (1.0, 2.0),
        "ROUNDS": 1,
        "RATES_KHZ": (1, 10),
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
    figure = panels_figure(result)
    assert to_png(figure).startswith(b"\x89PNG")
    for axis in figure.axes:
        assert axis.title.get_window_extent().x1 <= figure.bbox.x1
    stack_panels(figure)
    assert figure.axes[0].get_gridspec().nrows == len(result.panels)
    figure.draw_without_rendering()
    assert figure.axes[0].yaxis.label.get_window_extent().y1 <= figure.bbox.y1


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
    at_1_khz = [
        row["a second rendered (ms)"] for row in rates.rows if row["acceleration (kHz)"] == 1
    ]
    rendered, longest = results["pipeline"].targets
    assert (rendered.measured, rendered.bound) == (max(at_1_khz), 20.0)
    assert longest.measured > 0.0
