"""LeRobot itself records through mmt and reads what is exported; run where it is installed.

Its data sets come with `pip install 'lerobot[dataset]'`, its commands with `pip install lerobot`.
"""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from session_samples import made_frames

from mmt.session.data import RecordedSession
from mmt.session.files import read_session
from mmt_bridges.lerobot.dataset import export_lerobot

PROGRAM = Path(__file__).with_name("lerobot_dataset_program.py")
READER = Path(__file__).with_name("lerobot_program.py")
PACKAGES = ("lerobot", "datasets", "rerun", "imageio", "diffusers", "cv2")
SCENE = """
[link]
[simulated]
surface = "wood"
[hand]
[force_feedback]
[recording]
file = "session.mcap"
"""
PLUGIN = ("--robot.discover_packages_path=mmt_bridges.lerobot", "--robot.type=mmt")
ROBOT = (*PLUGIN, "--robot.scene=scene.toml")
HAND = ("--teleop.type=mmt", "--teleop.scene=scene.toml")
DATA_SET = ("--dataset.repo_id=me/strokes", "--dataset.root=strokes")

CAMERA = """
from dataclasses import dataclass

import numpy as np
from lerobot.cameras import Camera, CameraConfig


@CameraConfig.register_subclass("made")
@dataclass(kw_only=True)
class MadeConfig(CameraConfig): ...


class Made(Camera):
    is_connected = False

    @staticmethod
    def find_cameras():
        return []

    def connect(self, warmup=True):
        self.is_connected = True

    def read(self, color_mode=None):
        return np.full((self.height, self.width, 3), 99, np.uint8)

    def async_read(self, timeout_ms=0):
        return self.read()

    def disconnect(self):
        self.is_connected = False
"""
"""A camera that needs no hardware, in a package that LeRobot discovers."""
TRAIN = """
import json, sys
from lerobot.scripts.lerobot_train import main

for arguments in json.loads(sys.argv.pop()):
    sys.argv[1:] = arguments
    main()
"""
"""Trains as the command does, several times in one process: LeRobot is long in coming."""
SMALL = {
    "act": ("--policy.dim_model=32", "--policy.dim_feedforward=32", "--policy.chunk_size=8",
            "--policy.n_action_steps=8", "--policy.pretrained_backbone_weights=null"),
    "diffusion": ("--policy.down_dims=[32,64]", "--policy.crop_shape=null"),
}  # fmt: skip

NEEDS_DATA_SETS = pytest.mark.skipif(
    find_spec("lerobot") is None or find_spec("datasets") is None,
    reason="needs lerobot with its data sets: pip install 'lerobot[dataset]'",
)
NEEDS_COMMANDS = pytest.mark.skipif(
    any(find_spec(name) is None for name in PACKAGES),
    reason="needs lerobot with all that its commands need: pip install lerobot",
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def run(folder, *arguments):
    """Run a program of LeRobot, which asks no server."""
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "cache")}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, **offline},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def command(folder, name, *arguments):
    return run(folder, "-m", f"lerobot.scripts.lerobot_{name}", *arguments)


@NEEDS_COMMANDS
def test_what_is_recorded_opens_and_the_forces_rise_in_contact(folder):
    recorded = command(
        folder,
        "record",
        *(*ROBOT, *HAND, *DATA_SET),
        *("--dataset.single_task=stroke wood", "--dataset.fps=30", "--dataset.num_episodes=2"),
        *("--dataset.episode_time_s=4", "--dataset.reset_time_s=0"),
        *("--dataset.push_to_hub=false", "--play_sounds=false"),
    )
    assert recorded.returncode == 0, recorded.stderr
    read = run(folder, str(PROGRAM), "strokes")
    assert read.returncode == 0, read.stderr
    found = json.loads(read.stdout)
    assert (found["robot"], found["fps"]) == ("mmt", 30)
    assert len(found["episodes"]) == 2
    assert all(60 <= rows <= 121 for rows in found["episodes"])  # fewer on a busy machine
    state, action = np.array(found["state"]), np.array(found["action"])
    assert len(state) == sum(found["episodes"])
    np.testing.assert_array_equal(found["last"], state[-1])
    assert found["action_names"] == found["state_names"][:3]
    column = {name: state[:, k] for k, name in enumerate(found["state_names"])}
    pressed = column["force_z_n"] > 0.2
    assert not pressed[0]  # the tool begins above the surface
    assert pressed.mean() > 0.3
    assert action[pressed, 2].mean() < 0.0  # the hand goes below the surface
    level = column["vibration_rms_m_s2"]
    assert np.median(level[pressed]) > np.median(level[~pressed])
    frames = read_session(folder / "session.mcap").frames
    assert len(frames) > 30 * len(state)  # those of 1 kHz are beside it
    measured = frames["position_mm"][frames["force_n"][:, 2] > 0.2]
    low, high = measured.min(axis=0) - 1.0, measured.max(axis=0) + 1.0
    assert np.all((state[pressed, :3] > low) & (state[pressed, :3] < high))

    replayed = command(
        folder,
        "replay",
        *(*ROBOT, "--robot.moved_by=actions", *DATA_SET),
        *("--dataset.episode=0", "--play_sounds=false"),
    )
    assert replayed.returncode == 0, replayed.stderr
    again = read_session(folder / "session-2.mcap").frames
    rows = found["episodes"][0]
    reached = np.sort(again["position_mm"][:, 0])[[0, -1]]
    asked = np.sort(action[:rows, 0])[[0, -1]]
    np.testing.assert_allclose(reached, asked, atol=5.0)  # along x it strokes over 50 mm and more


@NEEDS_COMMANDS
@pytest.mark.timeout(900)
def test_stock_policies_train_on_what_is_recorded_and_on_what_is_exported(folder):
    (folder / "camera").mkdir()
    (folder / "camera" / "__init__.py").write_text(CAMERA)
    recorded = command(
        folder,
        "record",
        *(*ROBOT, *HAND, *DATA_SET, "--teleop.discover_packages_path=camera"),
        "--robot.cameras={front: {type: made, width: 96, height: 96, fps: 30}}",
        *("--dataset.single_task=stroke wood", "--dataset.fps=30", "--dataset.num_episodes=1"),
        *("--dataset.episode_time_s=4", "--dataset.reset_time_s=0", "--dataset.vcodec=h264"),
        *("--dataset.push_to_hub=false", "--play_sounds=false"),
    )
    assert recorded.returncode == 0, recorded.stderr
    export_lerobot([read_session(folder / "session.mcap")], folder / "exported", fps=30)
    runs = []
    for root in ("strokes", "exported"):
        info = json.loads((folder / root / "meta/info.json").read_text())
        felt = info["features"]["observation.environment_state"]["names"]
        assert felt == ["force_x_n", "force_y_n", "force_z_n", "vibration_rms_m_s2"]
        assert "observation.environment_state" in (folder / root / "meta/stats.json").read_text()
        assert ("observation.images.front" in info["features"]) == (root == "strokes")
        runs += [
            [
                *("--dataset.repo_id=me/strokes", f"--dataset.root={root}"),
                "--dataset.video_backend=pyav",
                *(f"--policy.type={policy}", "--policy.device=cpu", "--policy.push_to_hub=false"),
                *("--steps=2", "--batch_size=2", "--num_workers=0", "--log_freq=1", *small),
                *("--save_checkpoint=false", f"--output_dir={root}-{policy}"),
            ]
            for policy, small in SMALL.items()
        ]
    trained = run(folder, "-c", TRAIN, json.dumps(runs))
    assert trained.returncode == 0, trained.stderr
    losses = re.findall(r"loss:([\d.]+)", trained.stdout + trained.stderr)
    assert len(losses) == 2 * len(runs), trained.stderr


@NEEDS_COMMANDS
def test_the_hand_may_be_connected_first_and_a_problem_is_one_sentence(folder):
    shown = command(folder, "teleoperate", *ROBOT, *HAND, "--fps=30", "--teleop_time_s=1")
    assert shown.returncode == 0, shown.stderr
    assert "Teleop loop time" in shown.stdout
    scene = folder / "scene.toml"
    scene.write_text(SCENE.replace("[simulated]\n", '[devices]\nrobot = "nowhere"\n', 1))
    scene.write_text(scene.read_text().replace('surface = "wood"\n', ""))
    failed = command(folder, "teleoperate", *ROBOT, *HAND, "--fps=30", "--teleop_time_s=1")
    assert failed.returncode == 1
    last = failed.stderr.strip().splitlines()[-1]
    assert "mmt: the follower: " in last
    assert "driver 'nowhere' is not known" in last


def read_by_lerobot(folder):
    """Return what LeRobot finds in a data set."""
    result = run(folder.parent, str(READER), str(folder))
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@NEEDS_DATA_SETS
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


@NEEDS_DATA_SETS
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
