"""The settings by which Sphinx makes these pages a site; ./scripts/docs builds it."""

import re

from numpy.typing import ArrayLike
from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

import mmt
from mmt.core.arrays import FloatArray, RecordArray

project = "mmt"
release = mmt.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
default_role = "py:obj"
myst_heading_anchors = 4
nb_execution_mode = "off"  # a test runs the notebook; shown are its outputs as they are stored
autodoc_default_options = {"members": True, "inherited-members": "BaseModel,BaseException"}
autodoc_default_options["exclude-members"] = "model_config"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
napoleon_attr_annotations = napoleon_use_param = napoleon_use_rtype = False
ARRAYS = {"ArrayLike": ArrayLike, "NDArray[float64]": FloatArray, "NDArray": RecordArray}
WRITTEN = {name: stringify_annotation(kind, "smart") for name, kind in ARRAYS.items()}


def adapt_links(_app: Sphinx, page: str, source: list[str]) -> None:
    """Make downloads of the top level's pages, and the sidebar of the lists of the index."""
    source[0] = re.sub(r"\]\(((?:\.\./)+[A-Z]+\.md)(#[\w-]+)?\)", r"](path:\1)", source[0])
    section = ""
    for level, title, text in re.findall(r"^(##+) (.+)\n((?:(?!##).*\n)*)", source[0], re.M):
        section = title if level == "##" else section
        caption = title if title == section else f"{section}: {title.lower()}"
        links = re.findall(r"^- \[.+?\]\((.+?)\)", text, re.M)
        if page == "index" and links:
            lines = ["\n```{toctree}", ":hidden:", f":caption: {caption}", "", *links, "```\n"]
            source[0] += "\n".join(lines)


def name_arrays(_app: Sphinx, *about: object) -> list[str | None]:
    """Return arguments and result of a signature with the short names of array types."""
    halves = [str(half) if half else None for half in about[-2:]]
    for name, written in WRITTEN.items():
        halves = [half and half.replace(written, name) for half in halves]
    return halves


def keep_first_line(_app: Sphinx, what: str, *about: list[str]) -> None:
    """Begin with an empty comment: Napoleon takes what is before the first colon for a type."""
    if what in {"attribute", "property"}:
        about[-1][:0] = ["..", ""]


def setup(app: Sphinx) -> None:
    """Have Sphinx call the functions above."""
    app.connect("source-read", adapt_links)
    app.connect("autodoc-process-signature", name_arrays)
    app.connect("autodoc-process-docstring", keep_first_line, priority=400)  # Napoleon has 500
