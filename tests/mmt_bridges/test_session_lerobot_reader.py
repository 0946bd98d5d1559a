"""LeRobot itself reads what is exported; run where it is installed (`pip install lerobot`)."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from session_samples import made_frames

from mmt.session.data import RecordedSession
from mmt_bridges.lerobot.dataset import export_lerobot

PROGRAM = Path(__file__).with_name("lerobot_program.py")

pytestmark = pytest.mark.skipif(
    find_spec("lerobot") is None or find_spec("datasets") is None,
    reason="needs lerobot with its data sets: pip install 'lerobot[dataset]'",
)


def read_by_lerobot(folder):
    """Return what LeRobot finds, from a process of its own, which asks no server."""
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder.parent / "cache")}
    result = subprocess.run(
        [sys.executable, PROGRAM, folder],
        env={**os.environ, **offline},
        capture_output=True,
        text=True,
        check=False,
        timeout=150,
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_lerobot_finds_rows_episodes_and_statistics(tmp_path):
    folder = tmp_path / "set"
    sessions = [RecordedSession(made_frames(count, seed=count)) for count in (1000, 410)]
    export_lerobot(sessions, folder, fps=50, task="stroke oak")
    found = read_by_lerobot(folder)
    assert [found[name] for name in ("rows", "episodes", "fps", "robot")] == [70, 2, 50, "mmt"]
    assert found["rows_of_last"] == 20
    written = pq.read_table(folder / "data/chunk-000/file-000.parquet")
    columns = dict(found["columns"])
    assert set(columns.pop("task")) == {"stroke oak"}
    assert set(columns) == set(written.column_names)
    for name, values in columns.items():
        np.testing.assert_array_equal(values, written[name].to_pylist(), err_msg=name)
    np.testing.assert_array_equal(found["ahead"], columns["action"][:3])
    np.testing.assert_allclose(
        found["stats"]["action"]["mean"], np.mean(columns["action"], axis=0), rtol=1e-6
    )


def test_statistics_of_an_episode_are_those_of_lerobot(tmp_path):
    """Its quantiles are those of a histogram: to the width of one of 5000 bins, or one row."""
    export_lerobot([RecordedSession(made_frames(20_000))], tmp_path / "set")
    ours = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()[0]
    theirs = read_by_lerobot(tmp_path / "set")["stats_of_last"]
    names = {key.split("/")[1] for key in ours if key.startswith("stats/")}
    assert names == set(theirs)
    for feature, figures in theirs.items():
        width = np.subtract(figures["max"], figures["min"])
        for name, values in figures.items():
            mine = ours[f"stats/{feature}/{name}"]
            quantile = name.startswith("q")
            within = 0.02 * np.max(width) if quantile else 1e-6 * np.max(np.abs(figures["max"]))
            np.testing.assert_allclose(
                mine, values, atol=within + 1e-9, err_msg=f"{feature} {name}"
            )
