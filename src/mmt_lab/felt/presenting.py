"""What the hand feels, as a table, a figure and a report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from mmt.evaluation.document import Table
from mmt.evaluation.figures import COLOURS
from mmt.evaluation.report_files import picture
from mmt.evaluation.texts import number
from mmt.scene import PROFILES, Network
from mmt_lab.felt.judging import HOP, LEAST_RMS_M_S2, WINDOW
from mmt_lab.felt.summary import (
    AT_ONCE,
    METHODS,
    NETWORKS,
    SPANS_S,
    Outcome,
    as_dict,
    by_second,
    rows,
)
from mmt_lab.judged_report import write_judged_report

TITLE: Final = "What the operator feels, end to end"

DEFINITIONS: Final = {
    "compared with": "what the surface would give at the hand's own speed, force and heading at "
    "that moment, without a network: exact powers of the known texture",
    "moment": f"{WINDOW} samples under a Hann window, every {HOP} ms, where the hand is to feel "
    f"something or does: more than {LEAST_RMS_M_S2:g} m/s2 rms; less counts as so much",
    "level": "error of the power between 10 and 500 Hz, dB; rms over the moments of a span of "
    "session time, median over sessions",
    "bands": "the same over nine bands of that range and all moments",
    "onset, offset": "how much later than without a network vibration begins after a rest and "
    "ends before one, medians over strokes, ms",
    AT_ONCE: "a realisation of the texture itself under the hand: what is left is the scatter of "
    "a moment",
    "streaming": "the stream through the playout buffer, without a model",
    "published": "paper A: streamed until the start criterion, then rendered; the excitation's "
    "variance interpolated",
    "ours": 'the same with [texture] level = "gaussian_process" and shape = "smoothed"',
    "warm": 'as ours with [rendering] before = "warm": until the start criterion rendered from '
    "the shipped model that fits best; that of the texture itself is left out",
}

_STYLES: Final = {"streaming": 0, "published": 1, "ours": 2, "warm": 3, AT_ONCE: 6}


def felt_table(outcomes: Sequence[Outcome]) -> Table:
    """Return a row for each network and method."""
    spans = [f"{a:g}-{b:g} s" if b < 100 else f"from {a:g} s" for a, b in SPANS_S]
    columns = ["network", "method", *(f"level {span}" for span in spans)]
    columns += [f"bands {span}" for span in spans] + ["onset (ms)", "offset (ms)"]
    body = [
        [
            row.network,
            row.method,
            *(number(value, 2) for value in (*row.level_db, *row.bands_db)),
            number(row.onset_ms, 0),
            number(row.offset_ms, 0),
        ]
        for row in rows(outcomes)
    ]
    return Table(columns, body, "Errors in dB of what the hand feels, by session time.")


def felt_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Draw the level's error against session time, a panel for each network."""
    shown = [n for n in NETWORKS if any(one.case.network == n for one in outcomes)]
    figure = Figure(figsize=(2.55 * len(shown) + 0.6, 3.2), layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axis, network in zip(panels, shown, strict=True):
        for method in (*METHODS, AT_ONCE):
            error_db = by_second(outcomes, network, method)
            axis.plot(
                np.arange(len(error_db)) + 0.5,
                error_db,
                color=COLOURS[_STYLES[method]],
                linestyle=":" if method == AT_ONCE else "-",
                linewidth=1.6,
                label=method,
            )
        axis.set_title(f"{network}: {_delay(network)}", fontsize=9)
        axis.set_xlabel("session time (s)")
        axis.set_xlim(left=0.0)
        axis.grid(color="#e3e6ea", linewidth=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].set_yscale("log", base=2)
    panels[0].yaxis.set_major_formatter("{x:g}")
    panels[0].set_ylabel("error of what is felt (dB rms)")
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def _delay(network: str) -> str:
    """Return what a network does, in a few words."""
    emulated = Network.model_validate({"profile": network})
    words = f"{emulated.delay_ms:g} ± {emulated.jitter_ms:g} ms each way"
    return f"{words}, {100 * emulated.loss:g} % lost" if emulated.loss else words


def write_felt_report(directory: Path, outcomes: Sequence[Outcome]) -> Path:
    """Write ``report.html``, ``report.md`` and ``summary.json``; return the page.

    Raises
    ------
    InputError
        The directory cannot be written.
    """
    profiles = [(name, str(PROFILES[name])) for name in NETWORKS]
    return write_judged_report(
        directory,
        TITLE,
        ["At each moment: vibration at the leader against what the surface would give."],
        [
            picture("felt", "Level of what is felt, by session time.", felt_figure(outcomes)),
            felt_table(outcomes),
        ],
        DEFINITIONS,
        {**as_dict(outcomes), "definitions": DEFINITIONS},
        [Table(("network", "each way"), profiles)],
    )
