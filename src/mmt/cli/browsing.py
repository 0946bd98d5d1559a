"""Open a page in the person's browser."""

import os
import sys
import webbrowser


def open_page(url: str) -> bool:
    """Open a page in a browser with a window; say whether there was one.

    A browser in the terminal would take the place of what the command prints.
    """
    windows = sys.platform in ("win32", "darwin")
    if not windows and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False
