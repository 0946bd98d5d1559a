"""Prints what LeRobot itself finds in a data set, as JSON; a test runs it as a program."""

import json
import sys

import numpy as np
from lerobot.datasets.compute_stats import compute_episode_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def columns(data_set):
    items = [data_set[place] for place in range(len(data_set))]
    return {
        name: [item[name] if name == "task" else item[name].tolist() for item in items]
        for name in items[0]
    }


def main(folder):
    whole = LeRobotDataset("local/whole", root=folder)
    last = LeRobotDataset("local/last", root=folder, episodes=[whole.num_episodes - 1])
    step_s = 1.0 / whole.fps
    ahead = LeRobotDataset(
        "local/ahead", root=folder, delta_timestamps={"action": [-step_s, 0.0, step_s]}
    )
    episode = {
        name: np.array(values) for name, values in columns(last).items() if name in whole.features
    }
    statistics = compute_episode_stats(episode, whole.features)
    found = {
        "rows": len(whole),
        "episodes": whole.num_episodes,
        "fps": whole.fps,
        "robot": whole.meta.robot_type,
        "columns": columns(whole),
        "stats": {
            feature: {name: np.asarray(value).tolist() for name, value in figures.items()}
            for feature, figures in whole.meta.stats.items()
        },
        "rows_of_last": len(last),
        "stats_of_last": {
            feature: {name: np.asarray(value).tolist() for name, value in figures.items()}
            for feature, figures in statistics.items()
        },
        "ahead": ahead[1]["action"].tolist(),
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1])
