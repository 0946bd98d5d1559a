"""Sample selection on any textures: trials, knocks, and what is made of the results."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt_lab.experiments import selection
from mmt_lab.selection import sessions
from mmt_lab.selection.knocks import SAMPLES, read_taps
from mmt_lab.selection.sessions import session_trials


def test_ours_finds_more_than_the_published_selection_whatever_the_order():
    results = {r.method: r for r in selection.run_texture("sandpaper", 1)}
    assert set(results) == set(selection.METHODS)
    assert results["ours"].detected >= 0.9
    assert results["ours"].detected >= results["published"].detected
    assert results["ours"].false_alarms <= 0.03
    assert results["ours"].same_when_shuffled
    assert results["ours"].compression > 2.7
    assert results["ours"].gfc_change > -0.005


def test_a_missed_target_is_said():
    good = selection.SelectionResult("felt", "ours", 0, 0.98, 0.01, 0.01, 5.0, 0.0, 0.0, True, 0.1)
    bad = replace(good, detected=0.5, same_when_shuffled=False, gfc_change=-0.1)
    for one, expected in (
        (good, set()),
        (bad, {"detected", "detected, as published", "loss of GFC", "same when shuffled"}),
    ):
        published = replace(good, method="published", detected=0.7)
        results = [one, published, replace(one, method="ours, model's data")]
        means, overall = selection.by_texture(results), selection.means_of(results, "all")
        missed = {each.what for each in selection.targets(overall) if not each.met}
        assert missed == expected
        rows = [*means, *overall]
        assert len(selection.selection_table(rows).rows) == 2 * len(selection.METHODS)
        assert json.loads(json.dumps(rows))[4]["method"] == "ours"


def write_taps(path, taps):
    rows = [
        "<tap><tapSpeed>50</tapSpeed><tapAccel>"
        + "".join(f"<value>{value:.9f}</value>" for value in tap)
        + "</tapAccel></tap>"
        for tap in taps
    ]
    path.write_text(f"<tapSet><numTap>{len(taps)}</numTap>{''.join(rows)}</tapSet>")


def test_taps_are_brought_to_the_rate_of_the_session_without_folding(tmp_path):
    time_s = np.arange(100) / 10_000.0
    slow = np.hanning(100) * np.sin(2 * np.pi * 200.0 * time_s)
    fast = np.hanning(100) * np.sin(2 * np.pi * 2300.0 * time_s)
    write_taps(tmp_path / "Taps_Felt.xml", np.array([slow, fast]))
    kept, lost = read_taps(tmp_path / "Taps_Felt.xml")
    assert kept.shape == (SAMPLES,)
    assert (kept**2).sum() / 1000.0 == pytest.approx((slow**2).sum() / 10_000.0, rel=0.05)
    assert (lost**2).sum() < 1e-3 * (kept**2).sum()


@pytest.mark.parametrize("content", ["<a/>", "no xml", "<tapSet><tapAccel/></tapSet>"])
def test_a_file_without_taps_is_refused_with_its_name(tmp_path, content):
    (tmp_path / "Taps_Felt.xml").write_text(content)
    with pytest.raises(InputError, match=r"taps .*Taps_Felt\.xml: "):
        read_taps(tmp_path / "Taps_Felt.xml")


def test_any_texture_is_segmented_and_knocked_on_with_its_own_taps(tmp_path):
    lone = np.zeros((1, 100))
    lone[0, 20:25] = 1.0
    write_taps(tmp_path / "Taps_wood.xml", lone)
    write_taps(tmp_path / "Taps_other.xml", np.random.default_rng(1).standard_normal((3, 100)))
    trials = session_trials("wood", "quick", 1, np.random.default_rng(2), tmp_path)
    assert trials.knocked.sum() == round(0.1 * len(trials.knocked)) >= 5
    tap = read_taps(tmp_path / "Taps_wood.xml")[0]
    for hit, heard, without in zip(
        trials.knocked, trials.data.segments, trials.without.segments, strict=True
    ):
        added = heard - without
        assert hit == added.any()
        if hit:
            assert added.var() == pytest.approx(0.4 * without.var(), rel=0.1)
            assert np.correlate(added, tap, "full").max() > 0.8 * np.linalg.norm(
                added
            ) * np.linalg.norm(tap)
    with pytest.raises(InputError, match="no Taps_MATERIAL"):
        session_trials("wood", "quick", 1, np.random.default_rng(2), tmp_path / "none")


def test_a_hand_without_steady_strokes_is_named(monkeypatch):
    monkeypatch.setattr(sessions, "DURATION_S", 2.0)
    with pytest.raises(InputError, match=r"the hand taps makes \d steady strokes in 3 sessions"):
        session_trials("wood", "taps", 1, np.random.default_rng(2))


def test_every_texture_has_a_row_for_each_method_and_all_have_their_mean():
    found = selection.run(textures="drawn-0,wood+bursts", hand="quick", seeds=1, workers=1)
    names = [row[0] for row in found.tables[0].rows]
    methods = len(selection.METHODS)
    assert names == methods * ["drawn-0"] + methods * ["wood+bursts"] + methods * ["all"]
    for mean in found.data["overall"]:
        assert 0.0 <= mean["false_alarms_without"] <= 1.0
        assert np.isfinite(mean["power_change_db"])
