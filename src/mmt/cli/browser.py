"""The browser of whoever sits at this machine, if there is one."""

import os
import sys
import threading
import webbrowser


def open_page(url: str) -> bool:
    """Open a page in a browser, without waiting; return whether there is one to open it.

    There is none where the terminal is all there is.
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
