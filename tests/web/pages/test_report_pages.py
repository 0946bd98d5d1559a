"""Reports in a real browser: what is on the screen, and on paper."""

from pathlib import Path

import numpy as np
import pytest
from page_browser import ILLEGIBLE, MARKS, OVERFLOW, PHONE, TABLET, a_file, api, browser

from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.reports.comparison import compare_reports
from mmt.evaluation.reports.comparison_report import write_comparison
from mmt.evaluation.reports.report import write_report
from mmt.scene import Scene
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt_lab.bench.command import write_bench_report
from mmt_lab.experiments.stability import findings_of
from mmt_lab.harness.findings import Axis, Curves, Findings, Panel, Spread
from mmt_lab.harness.report import write_report as write_findings
from mmt_lab.stability.families import CaseRow

__all__ = ["browser"]
pytestmark = MARKS

WIDE = (1440, 900)
PAPER = (718, 1000)
"""An A4 sheet within Chromium's margins, in its pixels."""

RUN = {
    "leader": {
        "outcome": "completed",
        "link": {"frames": 9000, "lost": 0, "clock": {"offset_ms": 0.012}},
        "vibration": {"mode": "synthesized", "switches": [{"time_s": 4.0, "mode": "fading"}]},
        "recording": {"file": "/a/folder/with/a/name/that/is/long/session.mcap"},
    }
}


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """One report of each kind that a command writes."""
    folder = tmp_path_factory.mktemp("reports")
    evaluations = []
    for seed, name in enumerate(("first", "second")):
        frames, truth = simulate_session(Scene(), "wood", 5.0, seed)
        session = RecordedSession(frames, path=Path(f"{name}.mcap"), annotations=truth)
        evaluations.append(evaluate_session(session))
    run, other = folder / "run", folder / "other"
    compared = folder / "compared"
    shown = write_report(run, evaluations[:1], title="demo", scene=Scene().dump(), run=RUN)
    write_report(other, evaluations[1:], title="demo", scene=Scene().dump(), run=RUN)
    curves = Curves()
    for order in (8, 16):
        curves.add("mmt", order, Spread(2.0, 1.9, 2.1), 1e-15 * order)
    panel = Panel("p", "By order", "order", Axis("time (µs)", "µs"), Axis("error", "error"),
                  curves.build())  # fmt: skip
    stage = Findings("Burg's method", "What was measured.", panels=(panel,), name="burg")
    walls, delays = [0.1, 1.0, 10.0], [0.0, 10.0, 100.0]
    loop = {"wall_n_mm": walls, "delay_ms": delays,
            "grows": (np.outer(delays, walls) > 10.0).tolist()}  # fmt: skip
    row = CaseRow("loop", "a map of walls and delays", "as theory", "as theory", True, 1.0, loop)
    return {
        "run": shown,
        "comparison": write_comparison(compare_reports(run, other), compared),
        "bench": write_bench_report(folder / "bench", [stage], {"python": "3.11"}),
        "stability": write_findings(folder / "stability", findings_of([row])),
    }  # fmt: skip


async def beyond_the_edge(page, selector):
    """Return by how many pixels what is in the widest of these elements is wider than it."""
    return await page.evaluate(
        """selector => Math.max(0, ...[...document.querySelectorAll(selector)].map(
            element => element.scrollWidth - element.clientWidth))""",
        selector,
    )


@pytest.mark.parametrize(
    ("size", "scheme"), [(WIDE, "light"), (TABLET, "dark")], ids=["desktop", "tablet"]
)
@pytest.mark.parametrize("kind", ["run", "comparison", "bench", "stability"])
async def test_every_report_is_whole_and_readable(browser, reports, kind, size, scheme):
    async with a_file(browser, reports[kind], size, scheme) as page:
        assert await page.locator("h1").is_visible()
        assert await page.evaluate("document.images.length") > 0
        assert await page.evaluate("[...document.images].every(image => image.naturalWidth > 100)")
        assert await page.evaluate(OVERFLOW) == 0
        if size == WIDE:  # on a tablet a table may scroll, by itself
            assert await beyond_the_edge(page, ".scroll") == 0
        assert await page.evaluate(ILLEGIBLE) == []


async def test_a_run_is_told_from_the_plane_to_its_scene(browser, reports):
    async with a_file(browser, reports["run"], WIDE) as page:
        alts = [await image.get_attribute("alt") for image in await page.locator("img").all()]
        for words in ("The model as it grows", "GFC of the held-out", "Held-out segments"):
            assert any(alt.startswith(words) for alt in alts), words
        answers = await page.locator(".tiles li").all_inner_texts()
        assert [answer.split("\n")[0] for answer in answers] == [
            *("vibration", "readiness", "error of the level", "health")
        ]
        tops = (
            "[...document.querySelectorAll('h1, .tiles, img')].map(n => [n.tagName, n.offsetTop])"
        )
        order = sorted(await page.evaluate(tops), key=lambda place: place[1])
        assert [tag for tag, _ in order[:3]] == ["H1", "UL", "IMG"]
        assert alts[0].startswith("The model at")  # the map of errors, before its course
        counters = page.locator("details", has=page.get_by_text("Counters of the run"))
        assert not await counters.locator("table").first.is_visible()
        await counters.locator("summary").press("Enter")
        assert "synthesized" in await counters.locator(".tables").inner_text()
        scene = page.locator("details", has=page.get_by_text("The resolved scene"))
        await scene.locator("summary").press("Enter")
        await api.expect(scene.locator("pre")).to_be_visible()
        assert '"rate_hz": 1000' in await scene.inner_text()


@pytest.mark.parametrize("kind", ["run", "bench", "stability"])
async def test_a_telephone_gets_pictures_of_its_own(browser, reports, kind):
    widths = "[...document.images].map(i => [i.naturalWidth, i.clientWidth, innerWidth])"
    async with a_file(browser, reports[kind], PHONE, "dark") as page:
        assert await page.evaluate(OVERFLOW) == 0
        shown = await page.evaluate(widths)
        assert shown
        assert all(natural < 700 and 0.8 * inner < client for natural, client, inner in shown)


async def test_two_runs_stand_side_by_side_where_there_is_room(browser, reports):
    boxes = """[...document.querySelectorAll('.beside:not(.wide)')].map(pair =>
        [...pair.querySelectorAll('img')].map(image => image.getBoundingClientRect().top))"""
    async with a_file(browser, reports["comparison"], WIDE) as page:
        assert await page.locator("h3", has_text="model").is_visible()
        assert await page.locator("h3", has_text="power error").count() == 0  # both on one axis
        pairs = await page.evaluate(boxes)
        assert pairs
        assert all(len(pair) == 2 and pair[0] == pair[1] for pair in pairs)
        # pictures of several panels would be too small to read
        assert await page.evaluate("""[...document.querySelectorAll('.wide img')].every(
            image => image.clientWidth > 900)""")
        await page.set_viewport_size({"width": 600, "height": 900})
        assert all(above < below for above, below in await page.evaluate(boxes))


async def test_a_report_is_printed_whole(browser, reports):
    async with a_file(browser, reports["run"], PAPER) as page:
        await page.emulate_media(media="print")
        assert await page.locator("details pre").is_visible()
        assert await page.evaluate(OVERFLOW) == 0
        assert (await page.pdf(format="A4")).startswith(b"%PDF")
