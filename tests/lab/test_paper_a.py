"""Paper A's table and figures come from nothing but a seed."""

import json

from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.texture.signals.amplitude_spectra import Spectra
from mmt_lab.experiments.paper_a import run


def test_the_table_and_the_figures_of_paper_a_are_made(tmp_path):
    files = ["--json", str(tmp_path / "a.json"), "--report", str(tmp_path / "report")]
    done = CliRunner().invoke(app, ["lab", "paper-a", *files])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "a.json").read_text())
    for texture in found["textures"].values():
        steps = texture["steps"]
        assert [step["time_s"] for step in steps] == [2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5]
        distances = [step["distance"] for step in steps]
        assert distances == sorted(distances, reverse=True)  # a model only grows
        assert steps[-1]["gfc"] > 0.9
    complete_s = {texture["complete_s"] for texture in found["textures"].values()}
    assert len(complete_s) == 3  # hands that differ: never, and at two different times
    assert all(target["met"] for target in found["judged"])
    names = {path.name for path in (tmp_path / "report" / "figures").iterdir()}
    assert {"fig-4.png", "fig-3-wood.png", "fig-5-wood.png"} <= names


def test_raw_fourier_amplitudes_stay_below_what_the_paper_found_good():
    evaluations = run(seed=2, spectra=Spectra.FOURIER)
    for texture in evaluations.data["textures"].values():
        assert all(step["gfc"] < 0.85 for step in texture["steps"])
    assert len(evaluations.targets) == 1
    assert any("0.79" in sentence for sentence in evaluations.sentences)
