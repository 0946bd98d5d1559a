"""The documentation as a site, built as `./scripts/docs` does, with warnings as errors."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import mmt

DOCS = Path(__file__).parents[1] / "docs"
LACKING = [name for name in ("sphinx", "myst_nb", "furo") if find_spec(name) is None]

pytestmark = pytest.mark.skipif(
    bool(LACKING), reason=f"{', '.join(LACKING)} not installed (the extra docs)"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("build") / "site"
    options = ("--fail-on-warning", "--keep-going", "--quiet")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, DOCS, folder],
        check=False,
        capture_output=True,
        text=True,
        timeout=150,
    )
    assert (built.returncode, built.stderr) == (0, "")
    return folder


def test_the_sidebar_leads_to_every_page(site):
    text = (site / "index.html").read_text(encoding="utf-8")
    (sidebar,) = re.findall(r'<div class="sidebar-tree">(.*?)</div>', text, re.DOTALL)
    pages = {path.relative_to(DOCS) for kind in ("md", "ipynb") for path in DOCS.rglob(f"*.{kind}")}
    expected = {page.with_suffix(".html").as_posix() for page in pages} - {"index.html"}
    assert set(re.findall(r'href="([^"#]+)"', sidebar)) == expected


def test_every_name_of_the_library_is_described(site):
    text = (site / "reference/library.html").read_text(encoding="utf-8")
    described = re.findall(r'<dt [^>]*id="mmt\.(\w+)"', text)
    assert sorted(described) == sorted(mmt.__all__)
    for member in ("Synthesizer.render", "RecordedSession.plot", "ModellingSettings.order"):
        assert f'id="mmt.{member}"' in text
    assert "vibration in m/s2" in text


def test_pages_have_the_notebooks_pictures_and_lead_to_files_beside_them(site):
    text = (site / "how-to/first-model.html").read_text(encoding="utf-8")
    pictures = re.findall(r'<img [^>]*src="\.\./(_images/[^"]+)"', text)
    assert pictures
    for picture in pictures:
        assert (site / picture).stat().st_size > 1000
    text = (site / "how-to/run-the-demo.html").read_text(encoding="utf-8")
    (scene,) = re.findall(r'href="\.\./(_downloads/[^"]+/demo\.toml)"', text)
    assert (site / scene).read_bytes() == (DOCS.parent / "configs/demo.toml").read_bytes()
