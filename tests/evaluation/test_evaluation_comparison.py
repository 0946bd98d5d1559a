"""Two reports side by side: what differs, by how much, and nothing that does not."""

import json

import pytest
from command_runs import output_of, run_json

from mmt.core.errors import InputError
from mmt.evaluation.reports.comparison import compare_reports, figures
from mmt.evaluation.reports.comparison_report import both_over_time, write_comparison

PNG = b"\x89PNG\r\n\x1a\n and so on"


def report(folder, data, *pictures, name="summary.json"):
    (folder / "figures").mkdir(parents=True)
    (folder / name).write_text(json.dumps(data))
    for picture in pictures:
        (folder / "figures" / picture).write_bytes(PNG + picture.encode() + folder.name.encode())
    return folder


def compared(tmp_path, one, other):
    return compare_reports(report(tmp_path / "a", one), report(tmp_path / "b", other))


def evaluation(**changes):
    session = {
        "session": "wood",
        "order": 8,
        "steps": [{"time_s": 2.5, "gfc": 0.9}, {"time_s": 5.0, "gfc": 0.95}],
        **changes,
    }
    return {**session, "sessions": [session], "environment": {"python": "3.11"}}


def test_what_differs_is_said_once_with_its_place_and_size(tmp_path):
    other = [{"time_s": 2.5, "gfc": 0.9}, {"time_s": 5.0, "gfc": 0.855}]
    found = compared(tmp_path, evaluation(), evaluation(steps=other))
    (only,) = found.differences
    assert (only.section, only.name) == ("session / steps 5", "gfc")
    assert only.row == ("gfc", "0.95", "0.855", "-0.095", "0.9")
    assert found.equal == 6
    assert found.verdict == "1 figures and settings differ, 6 are equal."


def test_equal_reports_have_no_difference(tmp_path):
    nan = {"value": float("nan"), "list": [1, 2], "none": None}
    found = compared(tmp_path, nan, nan)
    assert (found.differences, found.equal) == ((), 3)


def test_items_are_told_apart_by_their_names_wherever_they_stand(tmp_path):
    rows = [{"case": "stiff", "held": True}, {"case": "soft", "held": True}]
    turned = [{"case": "soft", "held": False}, rows[0]]
    found = compared(tmp_path, {"rows": rows}, {"rows": turned})
    (only,) = found.differences
    assert (only.section, only.left, only.right) == ("rows soft", True, False)
    numbered = [names for names, _ in figures({"cells": [{"far": True}, {"far": False}]})]
    assert numbered == [("cells 1", "far"), ("cells 2", "far")]
    assert only.row[3:] == ("", "")


def test_what_only_one_has_is_shown(tmp_path):
    found = compared(tmp_path, {"x": 0.0, "old": 1}, {"x": 2.0, "new": "y"})
    assert [d.row for d in found.differences] == [
        ("x", "0", "2", "+2", ""),
        ("old", "1", "-", "", ""),
        ("new", "-", "y", "", ""),
    ]


def test_a_part_that_only_one_has_is_a_sentence(tmp_path):
    run = {"leader": {"ticks": {"late": 1}, "link": {"frames": 9}}}
    a = report(tmp_path / "a", {**evaluation(), "run": run})
    other = {"leader": {"ticks": {"late": 2}, "texture": {"samples": 3}}}
    b = report(tmp_path / "b", {"sessions": [], "run": other})
    found = compare_reports(a, b)
    assert found.missing_parts == [
        "Only A has session, environment, run / leader / link: 8 figures and settings.",
        "Only B has run / leader / texture: 1 figures and settings.",
    ]
    assert list(found.sections) == ["run / leader / ticks"]
    assert found.verdict == "10 figures and settings differ, 0 are equal."
    output = output_of("report", "compare", a, b)
    assert output.count("What differs most") == 1
    assert " ".join(output.split()).count("Only ") == 2
    assert "<h2>run / leader / link" not in write_comparison(found, tmp_path / "both").read_text()
    assert {"section": "run / leader / link", "name": "frames", "a": 9, "b": None} in (
        found.as_dict()["differences"]
    )


def test_headlines_say_which_is_better_and_settings_stand_apart(tmp_path):
    def one(start_s, right, order):
        data = evaluation(start_s=start_s, at_end={"within_jnd": right}, settings={"order": order})
        return {**data, "run": {"leader": {"ticks": {"late_share_1ms": 0.01}}}}

    found = compared(tmp_path, one(None, 0.9, 8), one(3.0, 0.8, 16))
    assert list(found.headlines) == [
        ("verdict", "completed; the model was never ready", "model ready since 3.0 s", ""),
        ("from the model since (s)", "never", "3.0", "better"),
        ("within JND, strokes made", "90 %", "80 %", "worse"),
        ("ticks over 1 ms late", "1 %", "1 %", "equal"),
    ]
    first, settings = found.answers
    assert len(first.rows) == 4
    assert settings.rows == [("session / settings", "order", "8", "16")]
    assert "settings" not in " ".join(found.sections)
    page = write_comparison(found, tmp_path / "both").read_text()
    assert page.index("worse") < page.index("<img") < page.index("<details>")


def test_the_page_shows_both_figures_side_by_side(tmp_path):
    found = compare_reports(
        report(tmp_path / "a", {"x": 1.0}, "gfc.png", "old.png"),
        report(tmp_path / "b", {"x": 3.0}, "gfc.png"),
    )
    page = write_comparison(found, tmp_path / "both").read_text()
    assert page.count("<figure>") == 3
    assert page.count('class="beside"') == 2
    assert (tmp_path / "both" / "figures" / "B-gfc.png").read_bytes().endswith(b"gfc.pngb")
    assert "A-old.png" in (tmp_path / "both" / "report.md").read_text()
    data = json.loads((tmp_path / "both" / "comparison.json").read_text())
    assert data["differences"] == [{"section": "", "name": "x", "a": 1.0, "b": 3.0}]


def test_courses_of_different_criteria_are_compared_by_the_one_that_both_have():
    by_share = [{"time_s": 2.5, "completion": 0.7, "distance": 8.0}]
    by_distance = [{"time_s": 2.5, "completion": 6.0, "distance": 6.0}]
    for other, title, drawn in (
        (by_distance, "distance sum", [8.0, 6.0]),
        (by_share, "completion", [0.7, 0.7]),
    ):
        axis = both_over_time((by_share, other)).axes[3]
        assert axis.get_title() == title
        assert [line.get_ydata()[0] for line in axis.lines] == drawn


def test_the_command_prints_writes_and_explains(tmp_path):
    a, b = report(tmp_path / "a", {"x": 1.0}), report(tmp_path / "b", {"x": 2.0})
    bench = report(tmp_path / "c", {"x": 2.0}, name="bench.json")
    figures, result = run_json(tmp_path, "report", "compare", a, b)
    assert "1 figures and settings differ" in result.output
    assert figures["equal"] == 0
    for other, message in ((bench, "bench.json"), (tmp_path / "none", "--report")):
        with pytest.raises(InputError, match=message):
            compare_reports(a, other)
    foreign = ({"sessions": 12}, {"run": "late"}, {"sessions": [{"steps": [1], "stop_s": ""}]})
    for content in ("[1]", "{", "", "[" * 100_000, *map(json.dumps, foreign)):
        (b / "summary.json").write_text(content)
        with pytest.raises(InputError, match=r"summary\.json"):
            compare_reports(a, b)
