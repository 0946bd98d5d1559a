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
from mmt_devices.iio.driver import IioOptions
from mmt_devices.inverse3 import options as haply
from mmt_devices.universal_robots import options as universal_robots

ROOT = Path(__file__).parents[2]
HOW_TO = ROOT / "docs" / "how-to"
FAULTS = ROOT / "docs" / "reference" / "device-faults.md"
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
    text = (HOW_TO / f"{page}.md").read_text(encoding="utf-8")
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
    text = (HOW_TO / f"{page}.md").read_text(encoding="utf-8")
    assert [name for name in options.model_fields if f"`{name}`" not in text] == []


def said_in(*folders):
    """Return every string of these folders of src, as Python joins them, and option names."""
    said = []
    for file in sorted(
        file for folder in folders for file in (ROOT / "src" / folder).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                said.append(node.value)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                said.append(node.target.id)
    return "\n".join(said)


@pytest.mark.parametrize(
    ("page", "folders"),
    [
        ("inverse3", ["mmt_devices/inverse3"]),
        ("universal-robots", ["mmt_devices/universal_robots"]),
        ("franka", ["mmt_devices/franka"]),
        (None, ["mmt/devices", "mmt_devices"]),
    ],
)
def test_what_a_page_quotes_is_said_by_the_drivers(page, folders):
    cells = [cell for cell, _ in rows(page, 2)] if page else [FAULTS.read_text(encoding="utf-8")]
    quoted = [quote for cell in cells for quote in re.findall(r"`([^`\n]+)`", cell)]
    assert len(quoted) > (10 if page else 60)
    pieces = {piece.strip() for quote in quoted for piece in quote.split("...")}
    said = said_in(*folders)
    assert sorted(p for p in pieces - {"on_lost", ".cal"} if p not in said) == []
