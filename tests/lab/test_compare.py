"""Methods side by side: sessions, what spoils them, judgement, statistics and ingredients."""

import json
from dataclasses import replace

import numpy as np
import pytest
from lab_runs import run_lab

from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples, empty_frames
from mmt.evaluation.model_errors import BAND_EDGES_HZ, band_edges_hz, band_errors_db
from mmt.evaluation.reports.document import ReportTable
from mmt.texture.online.history import build
from mmt.texture.settings import START_SHARE, STOP_SHARE, ModellingSettings
from mmt_lab.compare.ablations import INGREDIENTS, without
from mmt_lab.compare.cases import ComparisonCase
from mmt_lab.compare.judging import (
    FIGURES,
    Certainty,
    JudgedMethod,
    blocks_of,
    chosen_methods,
    judge,
)
from mmt_lab.compare.spoiling import LASTS_S, MOMENT_S, SPOILS, chosen_spoils, spoilt
from mmt_lab.compare.summary import RUN_TO_RUN_DB, MethodComparison
from mmt_lab.compare.tables import (
    calibration_table,
    errors_table,
    falls_table,
    largest_miscalibration,
    rates_table,
    shares_table,
)
from mmt_lab.experiments import ablations
from mmt_lab.experiments.compare import findings, method_blocks, targets
from mmt_lab.harness.experiment import rates_of
from mmt_lab.harness.report import write_report

TIMES = ("3 s", "10 s", "20 s", "30 s")


def judged(method, seed, share, moment="30 s", name="wood", spoil=""):
    figures = {**dict.fromkeys(FIGURES, 1.0), "within_jnd": share}
    labels = ("isotropic", name, name, seed, spoil, method, moment)
    return JudgedMethod(*labels, time_s=8.0, samples=20, figures=figures)


def comparison(gains, base=0.7, spoil="", moments=("30 s",)):
    rows = []
    for seed, gain in enumerate(gains):
        for moment in moments:
            rows += [judged("published", seed, base, moment, spoil=spoil)]
            rows += [judged("field", seed, base + gain, moment, spoil=spoil)]
    return MethodComparison(("published", "field"), tuple(rows))


def certainty(expected, true, spoil=""):
    times_s = np.arange(len(expected), dtype=float).tolist()
    updates = zip(times_s, expected, true, strict=True)
    return Certainty("isotropic", "wood", spoil, "field", tuple(updates))


def test_bands_are_nine_of_one_ratio_and_see_a_gain_in_one_of_them_alone():
    frequencies = np.arange(10.0, 501.0, 2.0)
    ratios = BAND_EDGES_HZ[1:] / BAND_EDGES_HZ[:-1]
    np.testing.assert_allclose(ratios, 50.0 ** (1 / 9))
    reference = np.ones((3, len(frequencies)))
    louder = reference.copy()
    louder[1, (frequencies >= BAND_EDGES_HZ[5]) & (frequencies < BAND_EDGES_HZ[6])] = 10.0
    errors = band_errors_db(louder, reference, frequencies)
    assert errors.shape == (3, 9)
    assert errors[1, 5] == pytest.approx(10.0)
    assert np.abs(np.delete(errors.ravel(), 14)).max() < 1e-9


@pytest.mark.parametrize("samples_per_frame", range(1, 11))
def test_bands_of_every_rate_begin_with_the_nine_and_end_at_half_of_it(samples_per_frame):
    edges = band_edges_hz(1000.0 * samples_per_frame)
    np.testing.assert_allclose(edges[:9], BAND_EDGES_HZ[:9], rtol=1e-12)
    assert edges[-1] == 500.0 * samples_per_frame
    octaves = np.diff(np.log(edges)) / (np.log(50.0) / 9)
    np.testing.assert_allclose(octaves[:-1], 1.0)
    assert 0.5 < octaves[-1] < 1.5


def test_an_unknown_method_is_refused_in_words():
    for listed in ("", "field,field", "published,best", "field-soup"):
        with pytest.raises(InputError, match="name some of published, field, field-"):
            chosen_methods(listed)
    assert chosen_methods("field, field-trust") == ["field", "field-trust"]
    with pytest.raises(InputError, match="--ingredients soup: name some of rough, mixture"):
        ablations.run("soup")


def test_rates_stand_beside_each_other_with_what_the_lowest_leaves_out():
    def at(rate_hz, name, above):
        bands_db = 1.0 + 2.0 * (np.sqrt(np.prod(pairs(rate_hz), axis=0)) > 1000.0)
        one = replace(judged("field", 1, 0.5, name=name), texture=name)
        one = replace(one, bands_db=tuple(bands_db.tolist()))
        return replace(one, acceleration_rate_hz=rate_hz, above_500_hz=above)

    def pairs(rate_hz):
        edges_hz = band_edges_hz(float(rate_hz))
        return edges_hz[1:], edges_hz[:-1]

    low = [at(1000, f"texture {place}", 0.0) for place in range(6)]
    high = [at(10_000, f"texture {place}", 0.1 * place) for place in range(6)]
    found = MethodComparison(("field",), (*low, *high))
    assert found.several_rates
    assert not MethodComparison(("field",), tuple(low)).several_rates
    assert rates_table(found).rows == [
        ["1", "field", "1.00", "-", "-", "0.500", "0.0 / 0.0"],
        ["10", "field", "1.00", "1.00", "3.00", "0.500", "25.0 / 30.0"],
    ]
    assert rates_table(found) in method_blocks(found)


def test_only_rates_of_a_scene_are_taken():
    assert rates_of("1000,10000") == [1000, 10000]
    for wrong in ("1500", "0", "11000", "quick", ""):
        with pytest.raises(InputError, match="acceleration"):
            rates_of(wrong)


@pytest.fixture(scope="module")
def session():
    return judge(ComparisonCase("felt", 3, hand="quick"), ["published", "field"], ["drift"])


def test_a_session_is_judged_at_four_times_and_where_each_criterion_is_met(session):
    found, _ = session
    for method in ("published", "field"):
        for spoil in ("", "drift"):
            moments = [o.moment for o in found if (o.method, o.spoil) == (method, spoil)]
            assert moments[:4] == list(TIMES)
            assert set(moments[4:]) <= {"start", "stop"}
    assert all(set(one.figures) == set(FIGURES) for one in found)
    assert all(0.0 <= one.figures[name] <= 1.0 for one in found for name in FIGURES[:2])


def test_a_model_that_states_its_error_is_checked_at_every_update(session):
    found, sure = session
    assert [(one.method, one.spoil) for one in sure] == [("field", ""), ("field", "drift")]
    for _, expected, true in sure[0].updates:
        assert 0.0 <= expected <= 1.0
        assert 0.0 <= true <= 1.0
    times_s = [time_s for time_s, _, _ in sure[0].updates]
    assert times_s == sorted(times_s)
    assert times_s[-1] == pytest.approx(30.0, abs=0.1)
    for one in found:
        assert (one.expected is None) == (one.method == "published")
        least = {"start": START_SHARE, "stop": STOP_SHARE}.get(one.moment, 0.0)
        assert one.expected is None or one.expected >= least


def test_without_a_model_the_shares_are_nought_and_there_are_no_errors():
    nothing = replace(judged("field", 0, 0.0), samples=0, figures={"within_jnd": 0.0})
    row = MethodComparison(("field",), (nothing, judged("field", 1, 0.8))).rows("wood")[0]
    assert row.figures["within_jnd"].mean == pytest.approx(0.4)
    assert row.figures["gfc"].sessions == 1


def test_differences_are_paired_and_count_beyond_three_standard_errors():
    def of(found, name="wood"):
        return next(d for d in found.differences(name) if d.figure == "within_jnd")

    same = of(comparison([0.1, -0.1, 0.1, -0.1]))
    assert (same.mean, same.verdict) == (pytest.approx(0.0), "same")
    better = of(comparison([0.10, 0.12, 0.11, 0.09]), "isotropic")
    assert better.mean == pytest.approx(0.105)
    assert better.standard_error == pytest.approx(np.std([10, 12, 11, 9], ddof=1) / 200)
    assert better.verdict == "better"
    assert of(comparison([-0.10, -0.12, -0.11])).verdict == "worse"
    assert of(comparison([0.5])).verdict == "same"


def test_beside_every_median_are_the_mean_the_worst_and_how_many_are_below_one_half():
    found = comparison([0.0, 0.1, 0.2, 0.25, 0.3, 0.3, -0.6])
    cells = {row[1]: row for row in shares_table(found, "wood").rows}
    assert cells["field"][2] == "7 of 7"
    assert cells["field"][5] == "0.90 / 0.78 / 0.69 / 1"
    one = judged("field", 0, 0.7)
    off = {**one.figures, "band_error_db": 2.0 * RUN_TO_RUN_DB}
    table = errors_table(MethodComparison(("field",), (replace(one, figures=off),)), "wood")
    assert dict(zip(table.columns, table.rows[0], strict=True))["times run-to-run"] == "2.0"


def test_falls_are_paired_and_give_the_mean_and_the_worst():
    clean, spoilt = comparison([0.0] * 20), comparison([-0.5, *([-0.01] * 19)], spoil="held")
    found = replace(clean, judged=clean.judged + spoilt.judged)
    fall = next(f for f in found.falls() if (f.method, f.figure) == ("field", "within_jnd"))
    assert (fall.before, fall.most) == (pytest.approx(0.7), pytest.approx(0.5))
    assert fall.mean == pytest.approx((0.5 + 19 * 0.01) / 20)
    assert fall.percentile_95 == pytest.approx(np.percentile([0.5, *([0.01] * 19)], 95))
    assert len(falls_table(found).rows) == 4
    assert all(row.spoil == "" for row in found.rows("wood"))


def test_shares_are_gathered_by_what_was_expected():
    sure = certainty([0.55, 0.57, 0.99], [0.5, 0.7, 1.0])
    found = MethodComparison(("field",), (), (sure, certainty([0.1], [0.9], "held")))
    rows = calibration_table(found, "field").rows
    assert rows == [
        ["0.5 to 0.6", "2", "0.560", "0.600", "+0.040"],
        ["0.9 to 1.0", "1", "0.990", "1.000", "+0.010"],
    ]
    at_the_ends = MethodComparison(("field",), (), (certainty([0.0, 1.0], [0.0, 1.0]),))
    assert sum(int(row[1]) for row in calibration_table(at_the_ends, "field").rows) == 2
    assert len(calibration_table(MethodComparison(("field",), ()), "field").rows) == 0
    assert largest_miscalibration([sure]) is None
    assert largest_miscalibration([certainty([0.55] * 30, [0.65] * 30)]) == pytest.approx(0.1)


def test_a_threshold_is_calibrated_by_what_was_expected_when_it_was_met():
    starts = [
        replace(judged("field", seed, 0.7, "start"), expected=0.76, true=0.7, standardised=1.0)
        for seed in range(3)
    ]
    ends = [replace(one, moment="30 s", standardised=2.0) for one in starts]
    table = calibration_table(MethodComparison(("field",), (*starts, *ends)), "field")
    assert table.rows == [["at the start", "3", "0.760", "0.700", "-0.060"]]
    assert "2.00" in table.caption


def test_targets_are_missed_by_one_time_or_one_moment_that_spoils():
    lead = comparison([0.1] * 6, moments=TIMES)
    assert [target.met for target in targets(lead)] == [True]
    *before, last = lead.judged
    last = replace(last, figures={**last.figures, "within_jnd": 0.0})
    assert not targets(replace(lead, judged=(*before, last)))[0].met
    spoilt = comparison([0.05] * 6, spoil="knock", moments=TIMES)
    wrong = certainty([0.1] * 30, [0.9] * 30, "knock")  # the table of shares leaves it out too
    found = targets(replace(lead, judged=lead.judged + spoilt.judged, certainties=(wrong,)))
    assert [target.met for target in found] == [True, False, None]
    assert found[1].measured == pytest.approx(0.05)


@pytest.mark.parametrize("count", [0, 1])
def test_a_report_holds_the_figures_and_what_methods_say_of_their_error(tmp_path, count):
    sure = tuple(certainty([0.5, 0.9], [0.6, 0.9]) for _ in range(count))
    found = replace(comparison([0.1, 0.2, 0.3], moments=TIMES), certainties=sure)
    write_report(tmp_path, findings(found))
    text = (tmp_path / "report.md").read_text()
    assert ("means of tenths" in text) == bool(count)
    assert (tmp_path / "figures" / "calibration-field.png").exists() == bool(count)
    data = json.loads((tmp_path / "summary.json").read_text())
    assert len(data["sessions"]) == 24
    assert data["rows"][0]["figures"]["within_jnd"]["below_half"] == 0
    assert any(isinstance(block, ReportTable) for block in method_blocks(found))


def test_the_command_compares_on_named_textures(tmp_path):
    options = ("--seeds", "1", "--textures", "wood", "--workers", "1")
    data, _ = run_lab(tmp_path, "compare", *options, "--noise-free", "--spoil", "knock,lost-1")
    assert {row["moment"] for row in data["rows"]} >= set(TIMES)
    assert {fall["spoil"] for fall in data["falls"]} == {"knock", "lost-1"}
    with pytest.raises(InputError, match="soup not known, allowed are all, quiet-20"):
        chosen_spoils("knock,soup")
    assert chosen_spoils("all") == list(SPOILS)


@pytest.fixture(scope="module")
def frames():
    count = 15_000
    made = empty_frames(count, ("position", "force", "acceleration"))
    made["sequence"] = np.arange(count)
    made["time_ns"] = 5_000_000_000 + 1_000_000 * np.arange(count)
    made["acceleration_m_s2"] = np.random.default_rng(1).standard_normal((count, 3))
    made["acceleration_m_s2"][:, 2] += 9.81
    return made


def acceleration(frames, name):
    return spoilt(frames, name, 7)["acceleration_m_s2"].astype(np.float64)


BEGIN, END = round(1000 * MOMENT_S), round(1000 * (MOMENT_S + LASTS_S))


@pytest.mark.parametrize("name", SPOILS)
def test_all_is_as_it_was_before_the_moment_and_in_other_channels(frames, name):
    kept = frames.copy()
    found = spoilt(frames, name, 7)
    np.testing.assert_array_equal(frames, kept)
    same = np.isin(frames["sequence"], found["sequence"])
    for channel in ("time_ns", "position_mm", "force_n"):
        np.testing.assert_array_equal(found[channel], frames[channel][same])
    if not name.startswith("lost"):
        assert same.all()
        own, whole = found["acceleration_m_s2"], frames["acceleration_m_s2"]
        np.testing.assert_array_equal(own[:BEGIN], whole[:BEGIN])
        changed = np.flatnonzero((own != whole).any(axis=1))
        assert changed[0] in (BEGIN, BEGIN + 1)
        lasts = {"unplugged": 2000, "drift": 3000, "knock": 10, "spike": 1}.get(name, 300)
        assert changed[-1] < BEGIN + lasts
    np.testing.assert_array_equal(found, spoilt(frames, name, 7))


@pytest.mark.parametrize("by_db", [20, 40])
def test_a_quieter_moment_is_so_many_decibels_quieter_about_gravity(frames, by_db):
    own = acceleration(frames, f"quiet-{by_db}")[BEGIN:END]
    whole = frames["acceleration_m_s2"][BEGIN:END]
    ratio_db = 20.0 * np.log10(whole.std(axis=0) / own.std(axis=0))
    np.testing.assert_allclose(ratio_db, by_db, atol=0.01)
    np.testing.assert_allclose(own.mean(axis=0), whole.mean(axis=0), atol=1e-5)


def test_held_unplugged_and_saturated_sensors_carry_nothing(frames):
    assert (np.ptp(acceleration(frames, "held")[BEGIN:END], axis=0) == 0.0).all()
    assert not acceleration(frames, "unplugged")[BEGIN : BEGIN + 2000].any()
    saturated = np.abs(acceleration(frames, "saturated")[BEGIN:END])
    assert np.mean(saturated == saturated.max()) > 0.6


def test_what_is_added_has_the_size_stated(frames):
    def added(name):
        return acceleration(frames, name) - frames["acceleration_m_s2"].astype(np.float64)

    assert np.abs(added("knock")).max() == pytest.approx(60.0, abs=0.1)
    assert np.abs(added("hum")).max() == pytest.approx(5.0, abs=0.01)
    spectrum = np.abs(np.fft.rfft(added("hum")[BEGIN:END, 0]))
    assert np.fft.rfftfreq(END - BEGIN, 0.001)[spectrum.argmax()] == pytest.approx(50.0, abs=2)
    assert added("spike").sum() == pytest.approx(60.0, abs=0.01)
    assert added("drift")[-1] == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize("share", [1, 2, 5])
@pytest.mark.parametrize(("suffix", "together"), [("", 1), ("-in-threes", 3)])
def test_as_many_frames_are_lost_as_stated(frames, share, suffix, together):
    found = spoilt(frames, f"lost-{share}{suffix}", 3)
    assert 1.0 - len(found) / len(frames) == pytest.approx(0.01 * share, rel=0.25)
    gaps = np.diff(found["sequence"].astype(int)) - 1
    assert np.median(gaps[gaps > 0]) == together
    assert found["sequence"][0] == 0


HEADINGS = {"ridges", "nap"}
"""Ingredients of models over velocity and force alone."""


def rendered(case, blocks):
    model = build(blocks, ModellingSettings(inputs=case.inputs)).model_at(10.0)
    speeds, forces = (axis.ravel() for axis in np.meshgrid([11, 90, 200, 280], [0.11, 1.0, 2.5]))
    density = model.spectrum(speeds, forces, frequencies_hz=np.arange(8.0, 500.0, 4.0))
    return np.concatenate([density.ravel(), model.level_db(speeds, forces)[1]])


@pytest.mark.parametrize(
    ("texture", "names"), [("glass", set(INGREDIENTS) - HEADINGS), ("corduroy", HEADINGS)]
)
def test_each_ingredient_changes_the_model_and_comes_back(texture, names):
    case = ComparisonCase(texture, 3)
    blocks = blocks_of(case.session())[:10]
    whole = rendered(case, blocks)
    for name in sorted(names):
        with without(name):
            less = rendered(case, blocks)
        assert np.isfinite(less).all(), name
        assert not np.allclose(less, whole, rtol=1e-9), name
    np.testing.assert_array_equal(rendered(case, blocks), whole)


def test_the_experiment_says_what_an_ingredient_costs(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt_lab.harness.experiment.DRAWN", 1)
    monkeypatch.setattr("mmt_lab.experiments.ablations.INHOMOGENEOUS", ("plastic+patches",))
    options = ("--textures", "glass", "--ingredients", "smoothing", "--spoil", "knock")
    tables = run_lab(tmp_path, "ablations", *options, "--workers", "1")[0]["tables"]
    names = [table["caption"].split(",")[0].split(":")[0] for table in tables]
    assert names == [name for name in ("clean", "noisy", "drawn", "uneven", "spoilt") for _ in "12"]
    for table in tables:
        assert [row[0] for row in table["rows"]] == ["whole field", "smoothing"]
    worse = float(tables[3]["rows"][1][3])  # the spectrum at 30 s
    assert worse > 0.0


@pytest.mark.parametrize("count", [1, 5, 10])
def test_a_moment_spoils_the_samples_of_its_time(count):
    frames = empty_frames(20_000, samples_per_frame=count)
    frames["time_ns"] = np.arange(20_000) * 1_000_000
    where = np.flatnonzero(acceleration_samples(spoilt(frames, "spike", 1))[:, 2])
    assert where.tolist() == [count * (round(1000.0 * MOMENT_S) + 1) - 1]
    knocked = np.flatnonzero(acceleration_samples(spoilt(frames, "knock", 1))[:, 2])
    assert knocked[0] == where[0] + 1
    assert len(knocked) == 10 * count - 1
