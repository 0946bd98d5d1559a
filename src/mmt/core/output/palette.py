"""The colours of pages and plots: one meaning each, light and dark.

Text in `TEXT` reaches a contrast of 4.5 on its backgrounds, and the colours of each picture in
`MEETING` are at least 20 apart in CIEDE2000, with and without protanopia and deuteranopia. Tests
check both. Only faults are red. They are filled areas with text on them, because no red is both
bright enough as text on a dark background and distinct from vermilion.
"""

from collections.abc import Mapping
from typing import Final

LIGHT: Final[Mapping[str, str]] = {
    "ground": "#f9fafb",
    "panel": "#ffffff",
    "ink": "#1b2126",
    "faint": "#5b6670",
    "line": "#d5dade",
    "streamed": "#0072b2",
    "synthesized": "#c24e00",
    "measured": "#36424b",
    "third": "#087868",
    "known": "#9aa5ad",
    "unready": "#f0f5f9",
    "ready": "#5aa9dc",
    "waiting": "#d5dade",
    "on-waiting": "#1b2126",
    "running": "#087868",
    "on-running": "#ffffff",
    "degraded": "#f0b429",
    "on-degraded": "#1b2126",
    "fault": "#800c1c",
    "on-fault": "#ffffff",
}
"""Colours on white, for pages and all plots."""

DARK: Final[Mapping[str, str]] = {
    "ground": "#14181b",
    "panel": "#1d2327",
    "ink": "#e6eaed",
    "faint": "#a3aeb6",
    "line": "#3a444b",
    "streamed": "#56b4e9",
    "synthesized": "#ff8a3d",
    "measured": "#eaf2f8",
    "third": "#30c9aa",
    "known": "#7b868e",
    "unready": "#19252d",
    "ready": "#1b669d",
    "waiting": "#dde3e7",
    "on-waiting": "#14181b",
    "running": "#23a38a",
    "on-running": "#14181b",
    "degraded": "#ffd24a",
    "on-degraded": "#14181b",
    "fault": "#cb2f40",
    "on-fault": "#ffffff",
}
"""Colours of pages if the browser asks for a dark scheme."""

MEETING: Final[Mapping[str, tuple[str, ...]]] = {
    "vibration and spectra": ("measured", "streamed", "synthesized", "panel"),
    "spectra beside what is known": ("measured", "synthesized", "known"),
    "three axes": ("streamed", "synthesized", "third", "panel"),
    "samples and the hand over cells": ("measured", "synthesized", "unready"),
    "samples and the hand over ready cells": ("measured", "synthesized", "ready"),
    "states": ("waiting", "running", "degraded", "fault"),
    "faults beside vibration": ("fault", "streamed", "synthesized", "panel"),
}
"""Colours that appear together in one picture."""

TEXT: Final[Mapping[str, tuple[str, ...]]] = {
    "ink": ("ground", "panel", "unready", "ready"),
    "faint": ("ground", "panel"),
    "streamed": ("ground", "panel"),
    "synthesized": ("ground", "panel"),
    "third": ("ground", "panel"),
    **{f"on-{state}": (state,) for state in ("waiting", "running", "degraded", "fault")},
}
"""Colours of text, each with its backgrounds."""

SERIES: Final = (
    LIGHT["streamed"],
    LIGHT["synthesized"],
    LIGHT["third"],
    LIGHT["ink"],
    "#56b4e9",
    "#f0b429",
)
"""Colours of curves for sessions, methods or surfaces; all at least 20 apart."""

GRADED: Final = "YlOrBr"
"""matplotlib's colour map for amounts over blue cells: from pale to dark."""

SIGNED: Final = "PuOr_r"
"""matplotlib's colour map for errors: too little is purple, too much is orange."""


def style_sheet() -> str:
    """Return the colours as variables of CSS, such as ``--streamed``."""
    light, dark = (
        " ".join(f"--{name}: {colour};" for name, colour in colours.items())
        for colours in (LIGHT, DARK)
    )
    return (
        f":root {{ color-scheme: light dark; {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )
