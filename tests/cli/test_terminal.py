"""What a peer, a device or a file has sent moves nobody's cursor; a full disk is said."""

import errno
import io
import sys

import pytest
from rich.table import Table

from mmt.cli.common import STANDARD_OUTPUT, messages, output, print_error, write_json
from mmt.cli.importing import print_report
from mmt.core.errors import MmtError
from mmt.session.importing.checks import ImportReport

EVIL = "\x1b[2J\x1b]0;owned\x07\u202e\r"


def test_no_control_character_is_printed(capsys):
    table = Table(EVIL)
    table.add_row(EVIL)
    output.print(f"a\nb\tc{EVIL}", table)
    messages.print(EVIL)
    print_error(EVIL)
    print_report(EVIL, ImportReport((), None, (EVIL,)))
    told = capsys.readouterr()
    for text in (told.out, told.err):
        assert "[2J" in text
        assert not set(text) & set("\x1b\x07\u202e\r")
    assert told.out.startswith("a\nb")


class FullDisk(io.StringIO):
    def write(self, text):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_json_that_standard_output_does_not_take_is_an_error_for_a_person(monkeypatch):
    monkeypatch.setattr(sys, "stdout", FullDisk())
    with pytest.raises(MmtError, match="--json -: No space left on device"):
        write_json(STANDARD_OUTPUT, {"a": 1})
