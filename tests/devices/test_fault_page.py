"""The page of faults quotes what the drivers really say."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "device-faults.md"


def said():
    """Return every string of the drivers, joined as Python joins them, and their options."""
    strings = []
    folders = (ROOT / "src" / "mmt" / "devices", ROOT / "src" / "mmt_devices")
    for file in sorted(file for folder in folders for file in folder.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                strings.append(node.value)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                strings.append(node.target.id)
    return "\n".join(strings)


def test_what_the_page_of_faults_quotes_is_said_by_a_driver():
    quoted = re.findall(r"`([^`\n]+)`", PAGE.read_text(encoding="utf-8"))
    assert len(quoted) > 60
    known = said()
    pieces = {piece.strip() for quote in quoted for piece in quote.split("...")} - {
        "on_lost",
        ".cal",
    }
    assert sorted(piece for piece in pieces if piece not in known) == []
