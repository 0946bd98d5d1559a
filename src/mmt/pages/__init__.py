"""Web pages: static files that a browser runs as they are, and vendored libraries.

The libraries under ``vendor`` are copies of published releases, each beside its licence; so
the pages work without a network.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

_FOLDER: Final = Path(__file__).parent

_TYPES: Final = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}

_VENDORED: Final = {
    "uPlot.js": "vendor/uplot/uPlot.esm.js",
    "uPlot.css": "vendor/uplot/uPlot.min.css",
}


@dataclass(frozen=True)
class PageFile:
    """A file as it is served."""

    body: bytes
    content_type: str


def monitor_files() -> dict[str, PageFile]:
    """Return the monitor's files by their names in its page; some 200 KB."""
    own = {
        path.name: path for path in sorted((_FOLDER / "monitor").iterdir()) if path.suffix in _TYPES
    }
    vendored = {name: _FOLDER / path for name, path in _VENDORED.items()}
    return {
        name: PageFile(path.read_bytes(), _TYPES[path.suffix])
        for name, path in {**own, **vendored}.items()
    }
