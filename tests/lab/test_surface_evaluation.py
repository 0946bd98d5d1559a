"""Scores of sessions over several surfaces, with answers known beforehand."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from command_runs import run_json
from lab_runs import run_lab
from scipy.stats import poisson
from surface_courses import glass_and_sandpaper, stroked_over

from mmt.core.errors import InputError
from mmt.evaluation.recorded_surfaces import part_by_surface
from mmt.evaluation.reports.surface_report import account, stay_table
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import SurfaceCourse
from mmt.testing.simulation.surfaces.textures import get_surface, surface_from_annotations
from mmt.texture.online.updates import SurfaceChange
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt_lab.experiments import surfaces
from mmt_lab.experiments.surfaces import changes_table, groups, targets
from mmt_lab.surfaces import running
from mmt_lab.surfaces.running import (
    FoundChange,
    SurfaceResult,
    draw_surfaces,
    run_session,
    run_simulated,
    score,
)

SECOND = 1000


def change(at_s, from_s=None):
    frame = round(at_s * SECOND)
    since = frame - 200 if from_s is None else round(from_s * SECOND)
    return FoundChange(SurfaceChange("new", 1, 2, since, frame - 10, 20.0), frame)


def scored(places, found):
    """Score stays of two seconds each, with contact all the time."""
    truth = np.repeat(np.array(places, dtype=np.int64), 2 * SECOND)
    always = np.ones(len(truth), dtype=np.bool_)
    return score(truth, always, always, found)


@pytest.mark.parametrize(
    ("places", "found", "delays_s", "false_alarms"),
    [
        ([0, 1, 0], [change(2.3), change(4.4)], [0.3, 0.4], 0),
        ([0, 1], [change(1.0)], [None], 1),  # nothing had changed
        ([0, 1], [change(2.3), change(3.3)], [0.3], 1),  # found twice
        ([0, 1, 0], [change(4.12, from_s=3.8), change(4.4)], [2.12, 0.4], 0),  # just after it left
        ([0, 1, 0], [change(2.3, from_s=1.0), change(4.4)], [0.3, 0.4], 0),  # dated too early
        ([0, 1, 0], [change(2.05, from_s=1.0)], [None, None], 1),  # no whole block of the next one
    ],
)
def test_what_is_found_has_its_delay_or_is_a_false_alarm(places, found, delays_s, false_alarms):
    result = scored(places, found)
    assert list(result.delays_s) == delays_s
    assert result.false_alarms == false_alarms


def test_the_delay_counts_from_contact_and_stays_without_stroking_do_not_count():
    truth = np.repeat(np.array([0, 1, 0]), 2 * SECOND)
    contact = np.ones(len(truth), dtype=np.bool_)
    contact[1900:2500] = False
    stroking = contact.copy()
    stroking[4000:] = False
    result = score(truth, stroking, contact, [change(2.9)])
    assert result.delays_s == (0.4,)


def test_tables_and_targets_say_what_was_met():
    good = SurfaceResult("one", ("a", "b"), scored([0, 1, 0], [change(2.3)]))
    ((group, rows),) = groups([good]).items()
    assert [row["surfaces"] for row in rows] == ["2", "all"]
    assert len(changes_table(group, rows).rows) == 2
    assert targets(rows[-1:])[0].met
    alarmed = SurfaceResult("one", ("a",), scored([0, 0], [change(1.0)]))
    (rows,) = groups([alarmed]).values()
    assert targets(rows[-1:])[2].met is False


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_half_of_the_surfaces_of_a_grained_session_have_a_grain(count):
    drawn = {
        group: [get_surface(name) for name in draw_surfaces(group, count, 3)]
        for group in ("isotropic", "grained")
    }
    assert [len({surface.name for surface in each}) for each in drawn.values()] == [count] * 2
    assert all(surface.isotropic for surface in drawn["isotropic"])
    grained = sum(not surface.isotropic for surface in drawn["grained"])
    assert grained == max(2, (count + 1) // 2)


def test_sessions_are_drawn_from_the_textures_that_are_named(monkeypatch):
    monkeypatch.setattr(running, "DURATION_S", 0.6)
    named = ("drawn-0", "wood", "oak", "plastic+patches")
    results = run_simulated(1, textures=named, hand="quick", workers=1)
    for result in results:
        drawn = draw_surfaces(result.group, len(result.surfaces), 0, named)
        assert result.surfaces == tuple(drawn)
        assert set(drawn) <= set(named)
    assert {result.group for result in results} == {"isotropic", "grained"}
    alone = run_simulated(1, textures=["wood+bursts"], workers=1)
    assert [result.surfaces for result in alone] == [("wood+bursts",)]
    assert alone[0].score.delays_s == ()


def test_the_bound_of_a_rate_is_that_of_a_poisson_count():
    alarmed = SurfaceResult("one", ("a",), scored([0] * 900, [change(1.0)]))
    row = groups([alarmed])["recorded"][-1]
    hours = 0.5
    assert row["false_alarms_per_hour"] == 1 / hours
    assert poisson(hours * row["false_alarms_per_hour_most"]).cdf(1) == pytest.approx(0.05)


def test_the_command_scores_a_recorded_session(tmp_path):
    course = SurfaceCourse.draw(
        [get_surface("glass"), get_surface("sandpaper")],
        stay_s=4.0,
        when="contact",
        duration_s=7.5,
        seed=1,
    )
    frames, annotations = simulate_session(Scene(), course, 7.5, 1)
    write_session(tmp_path / "two.mcap", frames, annotations=annotations)
    report = ("--report", str(tmp_path / "report"))
    row = run_lab(tmp_path, "surfaces", str(tmp_path / "two.mcap"), *report)[0]["rows"][-1]
    assert row["stays"] >= 1
    assert row["missed"] == row["false_alarms"] == 0
    assert 0.0 < row["delay_s"] < 3.5  # within the stay
    assert (tmp_path / "report" / "report.html").exists()


def test_a_session_on_one_surface_or_with_missing_frames_is_refused(tmp_path):
    frames, annotations = simulate_session(Scene(), "glass", 0.2, 1)
    write_session(tmp_path / "one.mcap", frames, annotations=annotations)
    with pytest.raises(InputError, match="single surface"):
        surfaces.run([tmp_path / "one.mcap"])
    with pytest.raises(InputError, match="whole frames"):
        run_session("gaps", SurfaceCourse([get_surface("glass")], []), frames[5:])


@pytest.fixture(scope="module")
def over_two():
    frames, annotations = stroked_over(glass_and_sandpaper())
    again = SurfaceChange("recalled", 2, 1, 14_000, 14_000)  # said by a person
    return RecordedSession(frames, annotations=annotations, events=(asdict(again),))


def test_a_session_is_parted_by_its_surfaces(over_two):
    parts = part_by_surface(over_two, ModellingSettings(surfaces=SurfaceSettings()))
    assert [(stay.surface, stay.truth) for stay in parts.stays] == [
        (1, "glass"),
        (2, "sandpaper"),
        (1, "glass"),
    ]
    assert [a.to_s for a in parts.stays[:-1]] == [b.from_s for b in parts.stays[1:]]
    assert (parts.stays[0].from_s, parts.stays[-1].to_s) == (0.0, 17.0)
    assert len(parts.truth) == len(over_two.frames)
    lengths = {n: len(session.frames) for n, session in parts.sessions.items()}
    assert sum(lengths.values()) == len(over_two.frames)
    assert lengths[2] == round(1000 * (parts.stays[1].to_s - parts.stays[1].from_s))
    assert parts.missing == {1: 0, 2: 0}
    names = {n: surface_from_annotations(s.annotations).name for n, s in parts.sessions.items()}
    assert names == {1: "glass", 2: "sandpaper"}
    table = stay_table(parts)
    assert len(table.rows) == 3
    assert table.columns[-1] == "mostly on"
    assert account(parts).startswith("2 surfaces in 3 stays; the tool was really on 2")


def test_frames_that_are_missing_move_no_stay_and_no_truth(over_two):
    sequence = over_two.frames["sequence"]
    lacking = replace(over_two, frames=over_two.frames[(sequence < 3000) | (sequence >= 3100)])
    parts = part_by_surface(lacking, ModellingSettings(surfaces=SurfaceSettings()))
    assert [stay.surface for stay in parts.stays] == [1, 2, 1]
    assert parts.stays[-1].to_s == 17.0
    assert parts.missing == {1: 100, 2: 0}
    whole = part_by_surface(over_two, ModellingSettings(surfaces=SurfaceSettings())).truth
    np.testing.assert_array_equal(parts.truth, whole)  # by the time, as the picture of stays


def test_without_a_known_course_stays_have_no_truth(over_two):
    parts = part_by_surface(
        replace(over_two, annotations=b""), ModellingSettings(surfaces=SurfaceSettings())
    )
    assert [stay.truth for stay in parts.stays] == [None] * 3
    assert stay_table(parts).columns[-1] == "found at (s)"
    assert parts.sessions[1].annotations == b""


def test_the_report_has_the_model_of_each_surface(over_two, tmp_path):
    scene = scene_from_tables({"link": {}, "replay": {}, "texture": {"surfaces": {}}})
    path = tmp_path / "two.mcap"
    export_session(replace(over_two, scene=scene.dump()), path)
    sessions = run_json(tmp_path, "evaluate", path, "--report", tmp_path)[0]["sessions"]
    assert [session["session"] for session in sessions] == ["two, surface 1", "two, surface 2"]
    assert [session["surface"] for session in sessions] == ["glass", "sandpaper"]
    assert all(session["at_end"]["within_jnd"] > 0.5 for session in sessions)
    report = (tmp_path / "report.md").read_text()
    assert "2 surfaces in 3 stays" in report
    assert (tmp_path / "figures" / "surfaces.png").stat().st_size > 5000
