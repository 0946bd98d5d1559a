"""Open a page in the user's browser."""

import os
import sys
import threading
import webbrowser


def open_page(url: str) -> bool:
    """Open a page in a browser without waiting; return whether there is a browser.

    Without a graphical desktop there is none.
    """
    has_screen = sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER")
    )
    if not has_screen:
        return False
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    threading.Thread(target=browser.open, args=(url,), name="browser", daemon=True).start()
    return True
