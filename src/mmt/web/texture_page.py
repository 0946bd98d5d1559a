"""The texture page as one file with models, module and styles, which works offline from disk.

Its Content-Security-Policy allows only the page's own script and style, by their hashes, and
modules that the script makes from the page's text (``data:``). The page fetches nothing.
"""

import base64
import hashlib
import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mmt.core.errors import InputError
from mmt.core.output.palette import style_sheet
from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import TextureModel

_PAGES: Final = Path(__file__).parent / "pages"
_FOLDER: Final = _PAGES / "texture"
_BASE: Final = _PAGES / "shared" / "base.css"

MODULE: Final = _FOLDER / "mmt-texture.js"
"""JavaScript module that renders textures."""

MOST_BYTES: Final = 500_000
"""Largest page, small enough for an e-mail or a paper's supplement."""

_ELEMENT_PX: Final = 640


def texture_page(models: Sequence[str]) -> bytes:
    """Return a page that plays models, given in their JSON form (`mmt.texture.model.json_form`).

    Raises
    ------
    InputError
        There is no model, or the page would be larger than 500 kB.
    """
    if not models:
        raise InputError("no model was given: a page plays one at least")
    parts = {
        "style": "\n".join(
            [style_sheet(), _BASE.read_text(), (_FOLDER / "texture.css").read_text()]
        ),
        "module": MODULE.read_text(),
        "script": (_FOLDER / "texture.js").read_text(),
        "models": "\n".join(_inert(form) for form in models),
    }
    hashes = {name: _hash(parts[name]) for name in ("style", "script")}
    page = re.sub(
        r"\{\{(\w+)\.?(hash)?\}\}",
        lambda found: (hashes if found[2] else parts)[found[1]],
        (_FOLDER / "texture.html").read_text(),
    ).encode()
    if len(page) > MOST_BYTES:
        raise InputError(
            f"the page would have {len(page) / 1e3:.0f} kB with {len(models)} models, allowed are "
            f"{MOST_BYTES / 1e3:.0f}: write fewer into one page"
        )
    return page


def playing_element(model: TextureModel) -> str | None:
    """Return an HTML element that plays a model, for a notebook; None if it is too large."""
    try:
        page = base64.b64encode(texture_page([model_json(model, "model")])).decode()
    except InputError:
        return None
    return (
        f'<iframe src="data:text/html;base64,{page}" allow="autoplay" width="100%" '
        f'height="{_ELEMENT_PX}" style="border:0"></iframe>'
    )


def _inert(form: str) -> str:
    """Return a script element with a model, escaped so that the model cannot end the element."""
    text = form.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return f'<script type="application/json" class="model">{text}</script>'


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return html.escape(f"'sha256-{digest}'", quote=False)
