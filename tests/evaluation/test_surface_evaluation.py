"""Scores of sessions over several surfaces, with answers known beforehand."""

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.devices.simulated.course import SurfaceCourse
from mmt.devices.simulated.offline import simulate_session
from mmt.devices.simulated.textures import get_surface
from mmt.errors import InputError
from mmt.evaluation.surfaces.running import SurfaceResult, run_session
from mmt.evaluation.surfaces.scoring import Found, SurfaceScore, score
from mmt.evaluation.surfaces.tables import SurfaceEvaluation, surface_tables, verdicts
from mmt.scene import Scene
from mmt.session.writing import write_session
from mmt.texture.surfaces import SurfaceChange

SECOND = 1000


def change(
    kind: Literal["new", "recalled", "identified"], before: int, surface: int, at_s: float
) -> Found:
    frame = round(at_s * SECOND)
    return Found(SurfaceChange(kind, before, surface, frame - 200, frame - 10, 20.0), frame)


def scored(places: list[int], found: list[Found]) -> SurfaceScore:
    """Score stays of two seconds each, with contact all the time."""
    truth = np.repeat(np.array(places, dtype=np.int64), 2 * SECOND)
    always = np.ones(len(truth), dtype=np.bool_)
    return score(truth, always, always, found)


def test_what_is_found_at_once_is_right() -> None:
    found = [change("new", 1, 2, 2.3), change("recalled", 2, 1, 4.4)]
    result = scored([0, 1, 0], found)
    assert [stay.outcome for stay in result.stays] == ["right", "right"]
    assert [stay.known for stay in result.stays] == [False, True]
    assert [stay.delay_s for stay in result.stays] == [0.3, 0.4]
    assert result.stays[1].recall_s == 0.4
    assert (result.recalls, result.wrong_recalls, result.false_alarms) == (1, 0, 0)


def test_nothing_found_is_missed_and_a_change_without_one_is_a_false_alarm() -> None:
    result = scored([0, 1], [change("new", 1, 2, 1.0)])
    assert result.false_alarms == 1
    assert result.stays[0].outcome == "missed"
    assert result.stays[0].delay_s is None


def test_the_model_of_another_surface_is_a_wrong_recall() -> None:
    found = [change("new", 1, 2, 2.3), change("new", 2, 3, 4.3), change("recalled", 3, 2, 6.3)]
    result = scored([0, 1, 2, 0], found)
    assert (result.recalls, result.wrong_recalls) == (1, 1)
    assert result.stays[-1].outcome == "wrong"


def test_a_second_model_of_a_known_surface_is_doubled_until_it_is_identified() -> None:
    found = [change("new", 1, 2, 2.3), change("new", 2, 3, 4.3)]
    assert scored([0, 1, 0], found).stays[1].outcome == "doubled"
    result = scored([0, 1, 0], [*found, change("identified", 3, 1, 5.0)])
    assert result.stays[1].outcome == "right"
    assert result.stays[1].delay_s == 0.3
    assert result.stays[1].recall_s == 1.0
    assert result.false_alarms == 0


def test_the_delay_counts_from_contact_and_stays_without_stroking_do_not_count() -> None:
    truth = np.repeat(np.array([0, 1, 0]), 2 * SECOND)
    contact = np.ones(len(truth), dtype=np.bool_)
    contact[1900:2500] = False
    stroking = contact.copy()
    stroking[4000:] = False
    result = score(truth, stroking, contact, [change("new", 1, 2, 2.9)])
    assert result.too_short == 1
    assert [stay.delay_s for stay in result.stays] == [0.4]
    assert not result.stays[0].in_contact


def test_tables_and_verdicts_say_what_was_met() -> None:
    good = SurfaceResult("one", ("a", "b"), scored([0, 1, 0], [change("new", 1, 2, 2.3)]))
    evaluation = SurfaceEvaluation([good])
    assert [row["surfaces"] for row in evaluation.rows()] == ["2", "all"]
    assert len(surface_tables(evaluation)[0].rows) == 2
    assert verdicts(evaluation)[0].endswith("met")
    alarmed = SurfaceResult("one", ("a",), scored([0, 0], [change("new", 1, 2, 1.0)]))
    assert verdicts(SurfaceEvaluation([alarmed]))[2].endswith("missed")


def test_frames_that_are_missing_are_refused() -> None:
    course = SurfaceCourse([get_surface("glass"), get_surface("wood")], [])
    frames, _ = simulate_session(Scene(), course, 0.2, 1)
    with pytest.raises(InputError, match="whole frames"):
        run_session("gaps", course, frames[5:])


def test_the_command_scores_a_recorded_session(tmp_path: Path) -> None:
    course = SurfaceCourse.draw(
        [get_surface("glass"), get_surface("sandpaper")],
        stay_s=4.0,
        when="contact",
        duration_s=7.5,
        seed=1,
    )
    frames, annotations = simulate_session(Scene(), course, 7.5, 1)
    write_session(tmp_path / "two.mcap", frames, annotations=annotations)
    figures = tmp_path / "figures.json"
    arguments = ["evaluate", "--surfaces", str(tmp_path / "two.mcap"), "--json", str(figures)]
    result = CliRunner().invoke(app, [*arguments, "--report", str(tmp_path / "report")])
    assert result.exit_code == 0, result.output
    row = json.loads(figures.read_text())["rows"][-1]
    assert row["stays"] >= 1
    assert row["missed"] == row["wrong_recalls"] == row["false_alarms"] == 0
    assert 0.0 < row["delay_s"] < 3.5  # within the stay
    assert (tmp_path / "report" / "report.html").exists()


def test_a_session_on_one_surface_has_no_course(tmp_path: Path) -> None:
    frames, annotations = simulate_session(Scene(), "glass", 0.2, 1)
    write_session(tmp_path / "one.mcap", frames, annotations=annotations)
    result = CliRunner().invoke(app, ["evaluate", "--surfaces", str(tmp_path / "one.mcap")])
    assert isinstance(result.exception, InputError)
    assert "single surface" in str(result.exception)
