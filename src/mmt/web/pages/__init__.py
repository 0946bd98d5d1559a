"""Web pages: static files that a browser runs as they are, and vendored libraries.

The libraries under ``vendor`` are copies of published releases, each beside its licence; so
the pages work without a network.
"""

from collections.abc import Mapping
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


MAIN: Final = "main.js"
"""The module that the monitor's page starts with, which differs for a run and a recording."""


def monitor_files(main: str = "monitor.js") -> dict[str, PageFile]:
    """Return the monitor's files by their names in its page; some 200 KB.

    Parameters
    ----------
    main
        The module to start with: ``monitor.js`` for a run, ``recording.js`` for a recording.
    """
    files = _files("monitor", _VENDORED)
    return {**files, MAIN: files[main]}


def player_files() -> dict[str, PageFile]:
    """Return the texture player's files by their names in its page."""
    return _files("player", {})


def _files(page: str, vendored: Mapping[str, str]) -> dict[str, PageFile]:
    """Return a page's own files, those that pages share, and libraries by the names given."""
    paths = {
        path.name: path
        for folder in ("shared", page)
        for path in sorted((_FOLDER / folder).iterdir())
        if path.suffix in _TYPES
    }
    paths |= {name: _FOLDER / path for name, path in vendored.items()}
    return {name: PageFile(path.read_bytes(), _TYPES[path.suffix]) for name, path in paths.items()}
