"""Read a data set by LeRobot itself, and write what it holds as JSON."""

import json
import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

found = LeRobotDataset("me/strokes", root=sys.argv[1])
columns = found.hf_dataset.with_format("numpy")
print(
    json.dumps(
        {
            "robot": found.meta.robot_type,
            "fps": found.fps,
            "episodes": np.asarray(found.meta.episodes["length"]).tolist(),
            "state_names": found.features["observation.state"]["names"],
            "action_names": found.features["action"]["names"],
            "state": np.stack(columns["observation.state"]).tolist(),
            "action": np.stack(columns["action"]).tolist(),
            "last": found[len(found) - 1]["observation.state"].tolist(),
        }
    )
)
