"""``mmt session export`` to a data set."""

import numpy as np
import pytest
from command_runs import output_of, refusal

from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session

pytest.importorskip("pyarrow", reason="needs the extra 'export'")


@pytest.fixture
def files(tmp_path):
    from mmt.scene import Scene

    files = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for seed, file in enumerate(files, start=1):
        frames, truth = simulate_session(Scene(), "oak", 0.5, seed)
        write_session(file, frames, annotations=truth)
    return files


def test_several_sessions_become_episodes_and_come_back_to_the_bit(tmp_path, files):
    folder = tmp_path / "set"
    options = ("--to", "lerobot", "--fps", 30, "--task", "stroke oak")
    said = output_of("session", "export", *files, folder, *options)
    assert "30 rows in 2 episodes written to" in " ".join(said.split())
    output_of("session", "import", folder, tmp_path / "back.mcap", "--episode", 1)
    back, original = read_session(tmp_path / "back.mcap"), read_session(files[1])
    np.testing.assert_array_equal(back.frames, original.frames)
    assert back.annotations == original.annotations


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("{a}", "{b}", "{out}.csv"), "takes one session, not 2"),
        (("{a}", "{out}.csv", "--fps", "30"), "--fps is for a data set"),
        (("{a}", "{out}.csv", "--task", "x"), "--task is for a data set"),
        (("{a}", "{out}", "--to", "lerobot", "--scalars"), "--scalars is for .mcap files"),
        (("{a}", "{out}", "--to", "zarr"), "--to zarr: allowed are lerobot"),
    ],
)
def test_options_that_do_not_go_together_are_explained(tmp_path, files, arguments, said):
    names = {"a": files[0], "b": files[1], "out": tmp_path / "out"}
    assert said in refusal("session", "export", *(each.format(**names) for each in arguments))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "b.mcap"]
