"""Reports: every file is there, well-formed, and says what was found."""

import io
import json
import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mmt.cli.common import Terminal
from mmt.core.errors import InputError
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.reports import figures, tables
from mmt.evaluation.reports.document import (
    Heading,
    Listing,
    Paragraph,
    Picture,
    ReportTable,
    as_rich,
    to_markdown,
)
from mmt.evaluation.reports.report import write_report
from mmt.evaluation.reports.report_files import to_html
from mmt.scene import Hand, Scene
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.settings import ModellingSettings

PNG = b"\x89PNG\r\n\x1a\n"
EMPTY_TAGS = {"meta", "img", "br", "link", "source"}
RUN = {
    "outcome": "completed",
    "leader": {
        "ready_s": 0.41,
        "vibration": {"switches": [{"time_s": 4.0, "mode": "model"}], "playout": {"delay_ms": 3}},
    },
    "follower": {"link": {"frames": 6000, "rejected": {}, "late": None}},
}


class Outline(HTMLParser):
    """Check that tags are nested properly, and collect what they hold."""

    def __init__(self):
        super().__init__()
        self.open, self.sources, self.text, self.count = [], [], "", Counter()

    def handle_starttag(self, tag, attrs):
        self.count[tag] += 1
        self.sources += [value for name, value in attrs if name in {"src", "srcset", "href"}]
        if tag not in EMPTY_TAGS:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def outline(page):
    parser = Outline()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    return parser


@pytest.fixture(scope="module")
def evaluations(stroked_session):
    frames, annotations = simulate_session(Scene(hand=Hand()), "wood", 6.0, seed=2)
    known = RecordedSession(frames, annotations=annotations, path=Path("wo|od <1>.mcap"))
    even = evaluate_session(stroked_session, ModellingSettings(order=6))
    return [even, evaluate_session(known, ModellingSettings())]


@pytest.fixture(scope="module")
def report(evaluations, tmp_path_factory):
    directory = tmp_path_factory.mktemp("report") / "new" / "folder"
    write_report(
        directory, evaluations, title="A <run> & more", scene={"session": {"seed": 1}}, run=RUN
    )
    return directory


def test_html_is_well_formed_and_needs_nothing_else(report):
    page = outline((report / "report.html").read_text(encoding="utf-8"))
    assert page.count["h1"] == 1
    assert page.count["img"] == page.count["source"] == 3 + 2 + 3
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    for said in ("A <run> & more", "wo|od <1>", "time s", "playout, delay ms", "just noticeable"):
        assert said in page.text
    for reference in ("held-out segments", "known texture"):
        assert page.text.count(f"Against the {reference} the level is right") == 1


def test_markdown_refers_to_the_figures_that_were_written(report):
    text = (report / "report.md").read_text(encoding="utf-8")
    drawn = sorted(path.name for path in (report / "figures").iterdir())
    assert len(drawn) == 8
    for name in drawn:
        assert f"](figures/{name})" in text
        assert (report / "figures" / name).read_bytes().startswith(PNG)


def test_summary_holds_every_figure(report, evaluations):
    summary = json.loads((report / "summary.json").read_text(encoding="utf-8"))
    assert [s["session"] for s in summary["sessions"]] == ["even", "wo|od <1>"]
    assert summary["sessions"][0]["stop_s"] == evaluations[0].stop_s
    assert summary["environment"]["numpy"] == np.__version__
    assert summary["run"] == RUN
    assert summary["scene"] == {"session": {"seed": 1}}


def test_a_run_alone_is_reported(tmp_path):
    page = outline(write_report(tmp_path, [], title="Run", run=RUN).read_text(encoding="utf-8"))
    assert "completed" in page.text
    assert "img" not in page.count
    assert json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["sessions"] == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="taken"):
        write_report(tmp_path / "taken" / "report", [])


def test_overview_has_paper_a_layout(evaluations):
    table = tables.by_time(evaluations, "distance", 2, "distance")
    assert table.columns == ("session", "2.5 s", "5 s", "7.5 s")
    first, second = table.rows
    assert first[1:] == tuple(f"{step.distance:.2f}" for step in evaluations[0].steps)
    assert second[3] == "-"


def test_tables_cut_no_figure_off_where_the_terminal_is_narrow(evaluations):
    whole, narrow = (Terminal(width=width, file=io.StringIO()) for width in (200, 40))
    for console in (whole, narrow):
        console.print(as_rich(tables.overview(evaluations), tables.steps(evaluations[0])))
    found = [set(re.findall(r"\d+\.\d+", each.file.getvalue())) for each in (whole, narrow)]
    assert found[0] == found[1] != set()
    tall = Terminal(width=16, file=io.StringIO())
    tall.print(as_rich(ReportTable(("figure", "B is"), [("a long name", "1.07")])))
    assert re.search(r"figure +is *\n.*\n *a long +1.07 *\n *name", tall.file.getvalue())


def test_numbers_stand_to_the_right():
    table = ReportTable(("a", "b", "c", "d"), [("1", "x", "-", "12 %"), ("-", "2", "", "never")])
    assert "| ---: | --- | --- | ---: |" in to_markdown([table])


def test_no_name_becomes_html_or_a_link():
    evil = "<img src=x onerror=alert(1)>&lt;[a](javascript:b)\n# c|d"
    blocks = [
        Heading(evil),
        Paragraph(evil),
        ReportTable((evil,), [(evil,)], evil),
        Picture("p.png", b"", evil),
        Listing(evil, "as it is: <b>\n```\n<script>"),
    ]
    page = outline(to_html(evil, blocks))
    assert page.text.count(evil) >= 6
    assert page.sources == ["data:image/png;base64,"]
    listing = to_markdown(blocks).rpartition("\n\n")[2]
    text = to_markdown(blocks).replace(listing, "")
    assert "<" not in text
    assert "&amp;lt;" in text
    assert text.count(r"\|d") == 2  # in cells
    assert text.count("](") == text.count(r"\[a](") + 1  # the picture's own
    assert "\n# c" not in text
    assert listing == "````\nas it is: <b>\n```\n<script>\n````\n"


def test_each_criterion_has_a_panel_with_its_thresholds_beside_the_curves(evaluations):
    by_distance = replace(evaluations[0], settings=ModellingSettings(method="published"))
    figure = figures.completion_over_time([by_distance, evaluations[1]])
    figure.draw_without_rendering()
    for axis, of, thresholds in zip(
        figure.axes, ("distance", "share"), ({7.5, 4.243}, {0.65, 0.84}), strict=True
    ):
        assert of in axis.get_ylabel()
        assert {float(text.get_text().split()[1]) for text in axis.texts} == thresholds
        right = axis.get_window_extent().x1
        assert all(text.get_window_extent().x0 > right for text in axis.texts)


def test_map_needs_a_known_texture(evaluations):
    with pytest.raises(ValueError, match="known texture"):
        figures.power_error_map(evaluations[0])
    drawn = figures.power_error_map(evaluations[1]).axes[0].collections[0].get_array()
    np.testing.assert_allclose(np.ravel(drawn), evaluations[1].power_map.power_error_db.ravel())
