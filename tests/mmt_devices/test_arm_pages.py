"""The pages of devices against their drivers: options, defaults, and what is said."""

import ast
import json
import re
from pathlib import Path

import pytest

from mmt.devices.ati.digital_ft import DigitalFtOptions
from mmt.devices.ati.gauges import GaugesOptions
from mmt.devices.ati.net_ft import NetFtOptions
from mmt.devices.openhaptics import options as openhaptics
from mmt_devices.bota.driver import BotaOptions
from mmt_devices.franka import options as franka
from mmt_devices.iio.options import IioOptions
from mmt_devices.inverse3 import options as haply
from mmt_devices.universal_robots import options as universal_robots

ROOT = Path(__file__).parents[2]
ROOMS = {
    "inverse3": "mmt_devices/inverse3",
    "universal-robots": "mmt_devices/universal_robots",
    "franka": "mmt_devices/franka",
}
"""Where the driver of a page is."""
OPTIONS = [
    ("inverse3", haply.HandleOptions),
    ("inverse3", haply.Inverse3RobotOptions),
    ("universal-robots", universal_robots.UrRobotOptions),
    ("universal-robots", universal_robots.ForceOptions),
    ("franka", franka.FrankaRobotOptions),
    ("openhaptics", openhaptics.HdOptions),
    ("openhaptics", openhaptics.HdRobotOptions),
]


def rows(page, columns):
    """Yield the cells of each row of a page's tables with so many columns."""
    text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text(encoding="utf-8")
    for line in re.findall(r"^\|.*\|$", text, re.MULTILINE):
        cells = [cell.strip() for cell in line[1:-1].split("|")]
        if len(cells) == columns:
            yield cells


@pytest.mark.parametrize(("page", "options"), OPTIONS)
def test_the_page_has_every_option_with_its_default(page, options):
    shown = {}
    for names, _, default, _ in rows(page, 4):
        keys, values = (re.findall("`([^`]+)`", cell) for cell in (names, default))
        words = [default] * len(keys)  # where there is no value
        shown |= dict(zip(keys, values or words, strict=True))
    for name, field in options.model_fields.items():
        if field.is_required():
            assert shown[name] == "required"
        elif field.default is None:
            assert shown[name]
        elif isinstance(field.default, str):
            assert shown[name] == field.default
        else:
            default = list(field.default) if isinstance(field.default, tuple) else field.default
            assert json.loads(shown[name]) == default, name


@pytest.mark.parametrize(
    ("page", "options"),
    [
        ("nano17", NetFtOptions),
        ("nano17", DigitalFtOptions),
        ("nano17", GaugesOptions),
        ("bota", BotaOptions),
        ("iio", IioOptions),
    ],
)
def test_the_page_names_every_option(page, options):
    text = (ROOT / "docs" / "how-to" / f"{page}.md").read_text(encoding="utf-8")
    assert [name for name in options.model_fields if f"`{name}`" not in text] == []


@pytest.mark.parametrize("page", ROOMS)
def test_what_the_page_quotes_is_said_by_the_driver(page):
    quoted = [quote for cell, _ in rows(page, 2) for quote in re.findall("`([^`]+)`", cell)]
    assert len(quoted) > 10
    said = ""
    for file in sorted((ROOT / "src" / ROOMS[page]).glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                said += node.value + "\n"
    pieces = {piece.strip() for quote in quoted for piece in quote.split("...")}
    assert sorted(piece for piece in pieces if piece not in said) == []
