"""A status line of a terminal, which is overwritten during a run."""

import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.control import Control
from rich.segment import ControlType
from rich.text import Text

from mmt.cli.ending import STYLES
from mmt.core.queued_output import is_behind

_ERASE = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))


class StatusLine:
    """Shows the state of a run in the last line of a terminal, or nothing without a terminal.

    Parameters
    ----------
    console
        Console of standard error.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._shown = False

    def show(self, verdict: Mapping[str, Any], text: str = "") -> None:
        """Show a verdict, as sent to pages, in one line, or `text` if the verdict is empty."""
        console = self._console
        if not console.is_terminal or console.is_dumb_terminal or is_behind(sys.stderr):
            return
        if verdict:
            text = "   ".join(filter(None, (verdict["time"], verdict["sentence"])))
            if verdict["readiness"]:
                text += f"   {verdict['readiness']}"
        line = Text(text, STYLES[verdict["state"]] if verdict else "", no_wrap=True)
        line.truncate(max(1, console.width - 1), overflow="ellipsis")
        self.clear()
        console.print(line, end="", soft_wrap=True)
        self._shown = True

    def clear(self) -> None:
        """Erase the line, so that other text can be printed there."""
        if self._shown:
            self._console.control(_ERASE)
            self._shown = False

    def print_line(self, sentence: str) -> None:
        """Print a permanent line."""
        self.clear()
        self._console.print(sentence, soft_wrap=True)
