"""Paper B's matching test and models, from simulated sessions of nine textures, one isotropic.

In the paper, people stroke a real sample and look for it among nine virtual textures; the matching
pairs are counted, but the paper gives no count. Here each texture is recorded for 30 s and modelled
by the paper's network, of line spectral frequencies and variance over velocity and force. Then
every sample is stroked anew, and all models render the same stroke, with filters renewed at 100 Hz
as in the paper. Their spectra are compared with the recorded ones, segment by segment. The virtual
texture with the least error is the match.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from mmt.core.output.palette import LIGHT
from mmt.evaluation.reports.document import Block, ReportTable, table_of
from mmt.evaluation.reports.report_files import picture
from mmt.testing.simulation.surfaces.textures import GRAINED
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ
from mmt.texture.signals.metrics import Spectra, amplitude_spectra
from mmt.texture.space import InputSpace
from mmt_lab.harness.experiment import Seed, SpectraOption
from mmt_lab.harness.findings import Findings, Target
from mmt_lab.matching import (
    RECORDED_S,
    RENEWAL_SAMPLES,
    STROKED_S,
    MatchedPair,
    StrokedSample,
    VirtualTexture,
    compare_pair,
    real_sample,
    virtual_texture,
)
from mmt_lab.selection.concatenated import RATE_HZ, network_settings

SHOWS: Final = "paper B's matching test by spectra, and its models' sizes"
TAKES: Final = "30 s"

TEXTURES: Final = tuple(surface.name for surface in GRAINED)
"""S1 to S3 plastics, S4 to S6 fabrics, S7 to S9 woods; S4 is isotropic, as in the paper."""

_THREADS_WHY: Final = (
    "the test renders offline; what runs side by side in the leader says `mmt scene explain`"
)
_COUNTED: Final = (
    "the paper counts them too, but gives no count, and refers to earlier work for its spectra"
)
_PEN_WHY: Final = "there is no pen: the normal force comes from the force sensor"


def run(seed: Seed = 1, spectra: SpectraOption = Spectra.WELCH) -> Findings:
    """Build the nine models, and compare each sample with all of them."""
    virtual = [virtual_texture(name, 2 * place + 100 * seed) for place, name in enumerate(TEXTURES)]
    real = [real_sample(name, 2 * place + 100 * seed + 1) for place, name in enumerate(TEXTURES)]
    pairs = {
        one.name: {of.name: compare_pair(one, of.model, seed, spectra) for of in virtual}
        for one in real
    }
    own = list(zip(real, virtual, strict=True))
    of_speed = {one.name: compare_pair(one, of.of_speed, seed, spectra) for one, of in own}
    least = {  # two renderings of one model, which gives the error of a perfect model
        one.name: compare_pair(one, of.model, seed, spectra, one.rendered(of.model, seed + 1))
        for one, of in own
    }
    matched = sum(_nearest(pairs[name]) == name for name in TEXTURES)

    tables = [_matching(pairs, of_speed, least), _sizes(virtual)]
    return Findings(
        title="Paper B: matching test and models",
        about=f"{RECORDED_S:g} s on each texture for its model, {STROKED_S:g} s in the test.",
        sentences=[f"{matched} of {len(TEXTURES)} pairs match; {_COUNTED}"],
        tables=tables,
        targets=_targets(matched, _estimates_a_second(real[0], virtual[0], seed)),
        blocks=lambda: _blocks(tables, pairs, virtual, real, seed),
        definitions={
            "error": "relative root mean square difference of amplitude spectra, mean over the "
            "segments of the stroke (paper C, equation 2)",
            "spectra": spectra.value,
            "two renderings": "the same between two renderings of one model: no error is below",
            "speed alone": "of the network over speed and force, without the heading",
            "numbers": "centres, weights and coefficients of equation 1",
        },
        data={
            "matched": matched,
            "pairs": {n: {m: asdict(p) for m, p in row.items()} for n, row in pairs.items()},
            "of_speed": {name: asdict(pair) for name, pair in of_speed.items()},
            "two_renderings": {name: asdict(pair) for name, pair in least.items()},
            "sizes": {one.name: _size(one) for one in virtual},
        },
    )


def _nearest(row: Mapping[str, MatchedPair], without: str = "") -> str:
    return min((name for name in row if name != without), key=lambda name: row[name].error)


def _targets(matched: int, estimates_a_second: float) -> tuple[Target, ...]:
    """Return mmt's figures, with the paper's as targets."""
    isotropic = sum(surface.isotropic for surface in GRAINED)
    settings = network_settings("anisotropic")
    inputs = InputSpace(settings.inputs).dimensions
    rate_hz = settings.vibration_rate_hz
    renewal_hz = rate_hz / RENEWAL_SAMPLES
    samples_a_second = estimates_a_second * RENEWAL_SAMPLES
    return (
        Target("pairs that match, of nine", matched, "at least", len(TEXTURES)),
        Target("textures", len(GRAINED), "about", 9),
        Target("of these isotropic", isotropic, "about", 1),
        Target("of these anisotropic", len(GRAINED) - isotropic, "about", 8),
        Target("inputs", inputs, "about", 3),
        Target("rate of velocity and force (Hz)", settings.rate_hz, "about", 1000.0),
        Target("vibration from (Hz)", VIBRATION_CUTOFF_HZ, "about", 10.0),
        Target("vibration to (Hz)", rate_hz / 2.0, "about", 1000.0),
        Target("filters estimated at (Hz)", renewal_hz, "about", 100.0),
        Target("filters that a thread can estimate (Hz)", estimates_a_second, "at least", 100.0),
        Target("output at (Hz)", rate_hz, "about", 2000.0),
        Target("output that a thread can make (Hz)", samples_a_second, "at least", 2000.0),
        Target("threads of blocks", None, "about", 3, reason=_THREADS_WHY),
        Target("levels of the pen's pressure", None, "about", 1024, reason=_PEN_WHY),
    )


def _estimates_a_second(sample: StrokedSample, one: VirtualTexture, seed: int) -> float:
    """Return how many filters one thread estimates per second, rendering samples in between."""
    started = time.perf_counter()
    rendered = sample.rendered(one.model, seed)
    return len(rendered) / RENEWAL_SAMPLES / (time.perf_counter() - started)


def _matching(
    pairs: Mapping[str, Mapping[str, MatchedPair]],
    of_speed: Mapping[str, MatchedPair],
    least: Mapping[str, MatchedPair],
) -> ReportTable:
    rows = []
    for place, (name, row) in enumerate(pairs.items(), start=1):
        own, other = row[name], _nearest(row, without=name)
        rows.append(
            {
                "sample": f"S{place}, {name}",
                "error": f"{own.error:.2f}",
                "two renderings": f"{least[name].error:.2f}",
                "next virtual": f"{row[other].error:.2f} ({other})",
                "GFC": f"{own.gfc:.3f}",
                "power (dB)": f"{own.power_db:.1f}",
                "speed alone": f"{of_speed[name].error:.2f}",
                "match": "yes" if _nearest(row) == name else f"no: {_nearest(row)}",
            }
        )
    return table_of(rows, "Matching test: recorded against synthesised spectra.")


def _size(one: VirtualTexture) -> dict[str, Any]:
    return {
        "points": len(one.model.samples),
        "numbers": one.numbers,
        "file_bytes": len(one.model.to_bytes()),
        "recorded_bytes": one.recorded_bytes,
    }


def _sizes(virtual: Sequence[VirtualTexture]) -> ReportTable:
    rows = []
    for place, one in enumerate(virtual, start=1):
        size = _size(one)
        rows.append(
            {
                "texture": f"S{place}, {one.name}",
                "points": str(size["points"]),
                "numbers": str(size["numbers"]),
                "model file (kB)": f"{size['file_bytes'] / 1e3:.1f}",
                "recording (kB)": f"{size['recorded_bytes'] / 1e3:.0f}",
            }
        )
    return table_of(rows, "Model sizes; the paper gives none.")


def _blocks(
    tables: Sequence[ReportTable],
    pairs: Mapping[str, Mapping[str, MatchedPair]],
    virtual: Sequence[VirtualTexture],
    real: Sequence[StrokedSample],
    seed: int,
) -> list[Block]:
    """Return the tables, every pair, and the spectra as a picture."""
    rows = [[name, *(f"{pair.error:.2f}" for pair in row.values())] for name, row in pairs.items()]
    every = ReportTable(["sample", *TEXTURES], rows, caption="Error of every pair.")
    drawn = _drawn_spectra(virtual, real, seed)
    caption = "Welch spectra, means over the strokes of a sample."
    return [*tables, every, picture("spectra", caption, drawn)]


def _drawn_spectra(
    virtual: Sequence[VirtualTexture], real: Sequence[StrokedSample], seed: int
) -> Figure:
    rows = len(real) // 3
    figure = Figure(figsize=(11.0, 2.7 * rows), layout="constrained")
    axes = figure.subplots(rows, 3, sharex=True).ravel()
    for axis, one, sample in zip(axes, virtual, real, strict=True):
        for label, signal in (
            ("measured", sample.vibration_m_s2),
            ("synthesized", sample.rendered(one.model, seed)),
        ):
            found = [amplitude_spectra(signal[part], RATE_HZ) for part in sample.segments]
            axis.plot(
                found[0][0], np.mean([a for _, a in found], 0), label=label, color=LIGHT[label]
            )
        axis.set_title(one.name)
    axes[0].legend(frameon=False)
    figure.supxlabel("frequency (Hz)")
    figure.supylabel("amplitude (m/s²/√Hz)")
    return figure
