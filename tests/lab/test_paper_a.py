"""Paper A's table and figures come from nothing but a seed."""

import json

from typer.testing import CliRunner

from mmt.cli.main import app


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
    assert len(complete_s) > 1  # hands that differ
    assert all(target["met"] for target in found["judged"])
    names = {path.name for path in (tmp_path / "report" / "figures").iterdir()}
    assert {"fig-4.png", "fig-3-wood.png", "fig-5-wood.png"} <= names
