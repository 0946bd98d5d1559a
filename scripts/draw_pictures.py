"""Draw the demo's pictures of README and docs, from one run; see ``scripts/pictures``."""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from image_files import write
from matplotlib.figure import Figure

from mmt.core.output.palette import LIGHT
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.recorded_surfaces import part_by_surface
from mmt.evaluation.reports import figures, growth
from mmt.evaluation.reports.surface_report import surfaces_over_time
from mmt.evaluation.results import Evaluation
from mmt.session.data import RecordedSession
from mmt.session.files import read_session
from mmt.texture.settings import ModellingSettings, SurfaceSettings

MODE_COLOURS: Final[Mapping[str, str]] = {
    "streamed": LIGHT["streamed"],
    "fading": LIGHT["ink"],
    "synthesized": LIGHT["synthesized"],
}


SURFACES_S: Final = 40.0
"""The time that the example scene of several surfaces lasts."""


def main() -> None:
    """Run the demo, evaluate its recording, draw, and write."""
    session, several = (run(scene) for scene in ("demo", "two-surfaces"))
    evaluation = replace(evaluate_session(session), name="demo")
    few = replace(evaluation, held_out=evaluation.held_out[:3])
    write("model-growth", growth.model_growth(from_five_samples_on(evaluation), panels=3))
    write("spectra", figures.held_out_spectra(few))
    write("completion", figures.completion_over_time([evaluation]))
    write("gfc", figures.gfc_over_time([evaluation]))
    write("power-error", figures.power_error_map(evaluation))
    write("switch", vibration_at_the_switch(session))
    settings = ModellingSettings(surfaces=SurfaceSettings())
    write("surfaces", surfaces_over_time(part_by_surface(several, settings), SURFACES_S))


def run(scene: str) -> RecordedSession:
    """Run an example scene; return its recording."""
    with tempfile.TemporaryDirectory() as directory:
        mmt = [sys.executable, "-m", "mmt.cli.entry", "main"]
        command = [*mmt, "demo", scene, "--output", directory]
        subprocess.run(command, check=True)  # noqa: S603 - our own interpreter and module
        return read_session(Path(directory) / "session.mcap")


def from_five_samples_on(evaluation: Evaluation) -> Evaluation:
    """Leave out the first models: a plane with one sample shows little."""
    history = evaluation.models
    kept = tuple(update for update in history.updates if update.samples >= 5)
    return replace(evaluation, models=replace(history, updates=kept))


def vibration_at_the_switch(session: RecordedSession) -> Figure:
    """Draw the vibration played around the switch from streamed to synthesized."""
    blocks = session.outputs
    switch_s = next(block.time_s for block in blocks if block.mode == "fading")
    figure = Figure(figsize=(8.4, 2.9), layout="constrained")
    axis = figure.subplots()
    played = np.concatenate([block.vibration_m_s2 for block in blocks])
    time_s = np.concatenate(
        [block.time_s + np.arange(len(block.vibration_m_s2)) / 1000.0 for block in blocks]
    )
    modes = np.repeat([b.mode for b in blocks], [len(b.vibration_m_s2) for b in blocks])
    for mode, colour in MODE_COLOURS.items():
        own = np.where(modes == mode, played, np.nan)
        axis.plot(time_s, own, color=colour, linewidth=0.8, label=mode)
    shown = np.abs(time_s - switch_s) < 0.6
    largest = 1.25 * float(np.abs(played[shown]).max())
    axis.set(xlim=(switch_s - 0.6, switch_s + 0.6), ylim=(-largest, largest))
    axis.set_xlabel("session time (s)")
    axis.set_ylabel("vibration (m/s²)")
    figures.style_axes(axis)
    axis.legend(loc="upper right", ncols=3, frameon=False, fontsize=9)
    return figure


if __name__ == "__main__":
    main()
