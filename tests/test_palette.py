"""Colours of pages and plots: told apart by everyone, legible, and said in one place."""

import re
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest

from mmt.core.output import palette

ROOT = Path(__file__).parents[1]
SCHEMES = {"light": palette.LIGHT, "dark": palette.DARK}
LEAST_CONTRAST = 4.5
LEAST_DIFFERENCE = 20.0
CELL_STEPS = 8

VISION = (
    np.eye(3),
    np.array([[0.152286, 1.052583, -0.204868],
              [0.114503, 0.786281, 0.099216],
              [-0.003882, -0.048116, 1.051998]]),
    np.array([[0.367322, 0.860646, -0.227968],
              [0.280085, 0.672501, 0.047413],
              [-0.011820, 0.042940, 0.968881]]),
)  # fmt: skip
"""Full vision, protanopia and deuteranopia: Machado, Oliveira and Fernandes (2009), linear RGB."""


def digits(colour):
    """Return the numbers (to 255) that hexadecimal digits stand for."""
    return np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)])


def linear(colour):
    """Return linear RGB of sRGB as hexadecimal digits."""
    encoded = digits(colour) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def contrast(one, other):
    """Return WCAG's contrast of two colours."""
    light = sorted(float(linear(c) @ (0.2126, 0.7152, 0.0722)) for c in (one, other))
    return (light[1] + 0.05) / (light[0] + 0.05)


def lab(rgb):
    """Return CIELAB (D65) of linear RGB."""
    to_xyz = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
    xyz = np.array(to_xyz) @ rgb / (0.95047, 1.0, 1.08883)
    x, y, z = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def ciede2000(one, other):
    """Return the difference of two CIELAB colours (Sharma, Wu and Dalal 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    mean7 = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2) ** 7
    stretch = 1.5 - 0.5 * np.sqrt(mean7 / (mean7 + 25.0**7))
    c1, c2 = np.hypot(a1 * stretch, b1), np.hypot(a2 * stretch, b2)
    h1, h2 = np.arctan2(b1, a1 * stretch), np.arctan2(b2, a2 * stretch)
    turn = np.angle(np.exp(1j * (h2 - h1))) if c1 * c2 > 0 else 0.0
    hue = np.degrees(h1 + turn / 2) % 360 if c1 * c2 > 0 else np.degrees(h1 + h2) % 360
    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    waves = ((1, 30, -0.17), (2, 0, 0.24), (3, -6, 0.32), (4, 63, -0.20))
    t = 1 + sum(size * np.cos(np.radians(n * hue - shift)) for n, shift, size in waves)
    away = (lightness - 50) ** 2
    dl = (l2 - l1) / (1 + 0.015 * away / np.sqrt(20 + away))
    dc = (c2 - c1) / (1 + 0.045 * chroma)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(turn / 2) / (1 + 0.015 * chroma * t)
    blue = 60 * np.exp(-(((hue - 275) / 25) ** 2))
    crossed = -np.sin(np.radians(blue)) * 2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    return float(np.sqrt(dl**2 + dc**2 + dh**2 + crossed * dc * dh))


def apart(one, other):
    """Return how far apart two colours are for those who tell them apart least."""
    return min(
        ciede2000(*(lab(np.clip(seen @ linear(c), 0, 1)) for c in (one, other))) for seen in VISION
    )


@pytest.mark.parametrize(
    ("one", "other", "difference"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
        ((36.4612, 47.8580, 18.3852), (36.2715, 50.5065, 21.2231), 1.4146),
    ],
)
def test_the_difference_is_that_of_its_authors(one, other, difference):
    assert ciede2000(one, other) == pytest.approx(difference, abs=1e-4)


def cells(colours):
    """Return the colours of cells, from those that lack all to those that lack nothing."""
    ends = [digits(colours[name]) for name in ("unready", "ready")]
    shares = np.linspace(0, 1, CELL_STEPS)
    mixed = (np.round(ends[0] + share * (ends[1] - ends[0])).astype(int) for share in shares)
    return ["#{:02x}{:02x}{:02x}".format(*one) for one in mixed]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_text_is_legible_on_all_that_it_stands_on(scheme):
    colours = SCHEMES[scheme]
    stands = [
        (text, colours[below]) for text, places in palette.TEXT.items() for below in places
    ] + [("ink", cell) for cell in cells(colours)]
    found = {(text, below): contrast(colours[text], below) for text, below in stands}
    assert {pair: value for pair, value in found.items() if value < LEAST_CONTRAST} == {}


def too_close(pairs):
    found = {pair: apart(*pair) for pair in pairs}
    return {pair: value for pair, value in found.items() if value < LEAST_DIFFERENCE}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_colours_that_meet_are_told_apart(scheme):
    colours = SCHEMES[scheme]
    pairs = [
        (colours[one], colours[other])
        for picture in (*palette.MEETING.values(), ("unready", "ready"))
        for one, other in combinations(picture, 2)
    ]
    curves = [colours[name] for name in ("measured", "synthesized")]
    assert too_close([*pairs, *product(curves, cells(colours))]) == {}
    assert too_close(combinations(palette.SERIES, 2)) == {}


def test_both_schemes_colour_the_same():
    assert list(palette.LIGHT) == list(palette.DARK)
    named = {
        name for part in (palette.MEETING, palette.TEXT) for each in part.values() for name in each
    }
    assert named | set(palette.TEXT) <= set(palette.LIGHT)


COLOUR = re.compile(r"#[0-9a-f]{6}\b|#[0-9a-f]{3}[;\"'\s]|\b(?:rgba?|hsla?)\(", re.IGNORECASE)
MATPLOTLIB = re.compile(r"\b(?:\w*colou?rs?|m[ef]c|c)=\"(?!none)\w+\"|cmap=\"")


def test_no_colour_stands_elsewhere():
    known = {*palette.LIGHT.values(), *palette.DARK.values()}
    found = []
    for folder in ("src", "scripts"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix not in {".py", ".js", ".css", ".html", ".svg"} or "vendor" in path.parts:
                continue
            if path.name == "palette.py":
                continue
            text = path.read_text(encoding="utf-8")
            pattern = MATPLOTLIB if path.suffix == ".py" else COLOUR
            found += [
                f"{path.relative_to(ROOT)}: {match.group()}"
                for each in {pattern, COLOUR}
                for match in each.finditer(text)
                if match.group() not in known
            ]
    assert found == []


def test_pages_use_colours_that_there_are():
    used = {
        (path.name, name)
        for path in (ROOT / "src").rglob("*.*")
        if path.suffix in {".css", ".js"} and "vendor" not in path.parts
        for name in re.findall(
            r"var\(--([\w-]+)\)|\b(?:css|colour)\(\"([\w-]+)\"\)", path.read_text()
        )
        for name in name
        if name
    }
    own = {"columns", "tile"}
    assert {pair for pair in used if pair[1] not in {*palette.LIGHT, *own}} == set()
