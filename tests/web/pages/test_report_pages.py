"""Reports in a real browser: what is on the screen, and on paper."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mmt.evaluation.comparison import compare_reports
from mmt.evaluation.comparison_report import write_comparison
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.report import write_report
from mmt.scene import Scene
from mmt.session import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt_lab.bench.command import write_bench_report
from mmt_lab.experiments.stability import findings_of
from mmt_lab.harness.findings import Axis, Curves, Findings, Panel, Spread
from mmt_lab.harness.report import write_report as write_findings
from mmt_lab.stability.cases import CaseRow

api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

DESKTOP, TABLET, PHONE = (1440, 900), (820, 1180), (390, 844)
PAPER = (718, 1000)
"""An A4 sheet within Chromium's margins, in its pixels."""

LONGEST_MS = 60_000

RUN = {
    "leader": {
        "outcome": "completed",
        "link": {"frames": 9000, "lost": 0, "clock": {"offset_ms": 0.012}},
        "vibration": {"mode": "synthesized", "switches": [{"time_s": 4.0, "mode": "fading"}]},
        "recording": {"file": "/a/folder/with/a/name/that/is/long/session.mcap"},
    }
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
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


@contextmanager
def a_page(
    browser: Any, report: Path, size: tuple[int, int] = DESKTOP, scheme: str = "light"
) -> Iterator[Any]:
    """Open a report without a network; nothing may be asked for, and nothing complained of."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    page.set_default_timeout(LONGEST_MS)
    asked: list[str] = []
    said: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    try:
        page.goto(report.as_uri())
        yield page
        assert [url for url in asked if not url.startswith("data:")] == [report.as_uri()]
        assert said == []
    finally:
        context.close()


def beyond_the_edge(page: Any, selector: str) -> int:
    """Return by how many pixels what is in the widest of these elements is wider than it."""
    width: int = page.evaluate(
        """selector => Math.max(0, ...[...document.querySelectorAll(selector)].map(
            element => element.scrollWidth - element.clientWidth))""",
        selector,
    )
    return width


def contrast(page: Any, selector: str) -> float:
    """Return the contrast of an element's text to the page, as WCAG 2 defines it."""
    colours = page.evaluate(
        """selector => [document.querySelector(selector), document.body].map((element, i) =>
            getComputedStyle(element)[i ? "backgroundColor" : "color"].match(/[0-9]+/g))""",
        selector,
    )
    channels = np.array(colours, dtype=float)[:, :3] / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    dark, light = sorted(linear @ (0.2126, 0.7152, 0.0722))
    return float((light + 0.05) / (dark + 0.05))


@pytest.mark.parametrize(
    ("size", "scheme"), [(DESKTOP, "light"), (TABLET, "dark")], ids=["desktop", "tablet"]
)
@pytest.mark.parametrize("kind", ["run", "comparison", "bench", "stability"])
def test_every_report_is_whole_and_readable(
    browser: Any, reports: dict[str, Path], kind: str, size: tuple[int, int], scheme: str
) -> None:
    with a_page(browser, reports[kind], size, scheme) as page:
        assert page.locator("h1").is_visible()
        assert page.evaluate("document.images.length") > 0
        assert page.evaluate("[...document.images].every(image => image.naturalWidth > 100)")
        assert beyond_the_edge(page, "html") == 0
        if size == DESKTOP:  # on a tablet a table may scroll, by itself
            assert beyond_the_edge(page, ".scroll") == 0
        for selector in ("p", "td", "th", "figcaption"):
            if page.locator(selector).count():
                assert contrast(page, selector) > 4.5, selector


def test_a_run_is_told_from_the_plane_to_its_scene(browser: Any, reports: dict[str, Path]) -> None:
    with a_page(browser, reports["run"]) as page:
        alts = [image.get_attribute("alt") for image in page.locator("img").all()]
        for words in ("The model as it grows", "GFC of the held-out", "Held-out segments"):
            assert any(alt.startswith(words) for alt in alts), words
        answers = page.locator(".tiles li")
        assert [li.inner_text().split("\n")[0] for li in answers.all()] == [
            *("vibration", "readiness", "error of the level", "health")
        ]
        tops = (
            "[...document.querySelectorAll('h1, .tiles, img')].map(n => [n.tagName, n.offsetTop])"
        )
        order = sorted(page.evaluate(tops), key=lambda place: place[1])
        assert [tag for tag, _ in order[:3]] == ["H1", "UL", "IMG"]
        assert alts[0].startswith("The model at")  # the map of errors, before its course
        counters = page.locator("details", has=page.get_by_text("Counters of the run"))
        assert not counters.locator("table").first.is_visible()
        counters.locator("summary").press("Enter")
        assert "synthesized" in counters.locator(".tables").inner_text()
        scene = page.locator("details", has=page.get_by_text("The resolved scene"))
        scene.locator("summary").press("Enter")
        api.expect(scene.locator("pre")).to_be_visible()
        assert '"rate_hz": 1000' in scene.inner_text()


def test_a_telephone_gets_pictures_of_its_own(browser: Any, reports: dict[str, Path]) -> None:
    widths = "[...document.images].map(i => [i.naturalWidth, i.clientWidth, innerWidth])"
    for kind in ("run", "bench", "stability"):
        with a_page(browser, reports[kind], PHONE, "dark") as page:
            assert beyond_the_edge(page, "html") == 0
            shown = page.evaluate(widths)
            assert shown
            assert all(natural < 700 and 0.8 * inner < client for natural, client, inner in shown)


def test_two_runs_stand_side_by_side_where_there_is_room(
    browser: Any, reports: dict[str, Path]
) -> None:
    boxes = """[...document.querySelectorAll('.beside:not(.wide)')].map(pair =>
        [...pair.querySelectorAll('img')].map(image => image.getBoundingClientRect().top))"""
    with a_page(browser, reports["comparison"]) as page:
        assert page.locator("h3", has_text="model").is_visible()
        assert page.locator("h3", has_text="power error").count() == 0  # both on one axis
        pairs = page.evaluate(boxes)
        assert pairs
        assert all(len(pair) == 2 and pair[0] == pair[1] for pair in pairs)
        # pictures of several panels would be too small to read
        assert page.evaluate("""[...document.querySelectorAll('.wide img')].every(
            image => image.clientWidth > 900)""")
        page.set_viewport_size({"width": 600, "height": 900})
        assert all(above < below for above, below in page.evaluate(boxes))


def test_a_report_is_printed_whole(browser: Any, reports: dict[str, Path]) -> None:
    with a_page(browser, reports["run"], PAPER) as page:
        page.emulate_media(media="print")
        assert page.locator("details pre").is_visible()
        assert beyond_the_edge(page, "html") == 0
        assert page.pdf(format="A4").startswith(b"%PDF")
