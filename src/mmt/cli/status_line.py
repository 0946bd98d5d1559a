"""One line of a terminal that is written over while a run goes on."""

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
    """Shows how a run stands in the last line of a terminal; elsewhere it shows nothing.

    Parameters
    ----------
    console
        The terminal, of standard error.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._shown = False

    def show(self, verdict: Mapping[str, Any], text: str = "") -> None:
        """Show a verdict, as a page gets it, or a text before there is one; in one line."""
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
        console.print(line, end="", soft_wrap=True, highlight=False)
        self._shown = True

    def clear(self) -> None:
        """Leave the line empty, for others to print there."""
        if self._shown:
            self._console.control(_ERASE)
            self._shown = False

    def say(self, sentence: str) -> None:
        """Print a line that stays."""
        self.clear()
        self._console.print(sentence, highlight=False, soft_wrap=True)
