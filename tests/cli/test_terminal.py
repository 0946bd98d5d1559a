"""What a peer, a device or a file has sent moves nobody's cursor."""

import pytest
from rich.table import Table

from mmt.cli.common import messages, output, print_error
from mmt.cli.importing import print_report
from mmt.session.importing.checks import ImportReport

EVIL = "\x1b[2J\x1b]0;owned\x07\u202e\r"


def test_no_control_character_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(EVIL)
    table.add_row(EVIL)
    output.print(f"a\nb\tc{EVIL}", table)
    messages.print(EVIL, highlight=False)
    print_error(EVIL)
    print_report(EVIL, ImportReport((), None, (EVIL,)))
    told = capsys.readouterr()
    for text in (told.out, told.err):
        assert "[2J" in text
        assert not set(text) & set("\x1b\x07\u202e\r")
    assert told.out.startswith("a\nb")
