"""Sessions as LeRobot data sets, and data sets as sessions."""

import json
import shutil
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from session_samples import made_frames

from mmt.core.errors import InputError, MmtError
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, import_session, read_session
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose
from mmt.session.importing.recording import import_recording, read_columns
from mmt_bridges.lerobot.dataset import export_lerobot
from mmt_bridges.lerobot.importing import _ranges
from mmt_bridges.lerobot.rows import low_rate_rows

pytestmark = pytest.mark.usefixtures("read_here")

pc = pytest.importorskip("pyarrow.compute", reason="needs the extra 'export'")
pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'export'")
pa = pytest.importorskip("pyarrow", reason="needs the extra 'export'")

SCENE = {"session": {"name": "wood"}}
EVENTS = [{"time_s": 0.5, "event": "mark"}]


def session_of(count, *, seed=1, steps=None, channels=None):
    channels = channels or ("position", "force", "acceleration")
    return RecordedSession(made_frames(count, channels, seed=seed, steps=steps), SCENE)


@pytest.fixture
def sessions():
    first = made_frames(1030, seed=1, steps=np.where(np.arange(1029) == 100, 60, 1))
    return [
        RecordedSession(first, SCENE, b"\x00truth", (), EVENTS),
        RecordedSession(made_frames(505, seed=2)),
    ]


@pytest.fixture
def folder(tmp_path, sessions):
    assert export_lerobot(sessions, tmp_path / "set", task="stroke oak") == 54 + 25
    return tmp_path / "set"


def read(folder, name):
    return pq.read_table(folder / name)


def arrays(folder, name):
    return np.array(read(folder, "data/chunk-000/file-000.parquet")[name].to_pylist())


def test_a_row_has_the_newest_frame_of_its_period_and_where_the_next_one_is(folder, sessions):
    frames = sessions[1].frames
    state, action = (arrays(folder, name)[54:] for name in ("observation.state", "action"))
    np.testing.assert_array_equal(state[:, :3], frames["position_mm"][19:500:20])
    np.testing.assert_array_equal(state[:, 3:6], frames["force_n"][19:500:20])
    np.testing.assert_array_equal(action[:-1], state[1:, :3])
    np.testing.assert_array_equal(action[-1], state[-1, :3])
    blocks = frames["acceleration_m_s2"][:500].reshape(25, 20, 3).astype(float)
    spread = np.sqrt(np.sum(np.var(blocks, axis=1), axis=1))
    np.testing.assert_allclose(state[:, 6], spread, rtol=1e-6)


def test_missing_frames_are_held_and_where_the_numbers_fall_rows_go_on(folder, sessions):
    counts = arrays(folder, "mmt.frames")[:54]
    assert counts.tolist() == [20, 20, 20, 20, 20, 1, 0, 0, *[20] * 46]
    state = arrays(folder, "observation.state")
    np.testing.assert_array_equal(state[6:8], state[[5, 5]])
    np.testing.assert_array_equal(state[5, :3], sessions[0].frames["position_mm"][100])
    assert state[5, 6] == 0.0
    frames = made_frames(100)
    frames["sequence"][50:] -= 30
    rows = low_rate_rows(RecordedSession(frames), 50)
    assert rows["mmt.frames"].tolist() == [20] * 5
    np.testing.assert_array_equal(rows["observation.state"][2, :3], frames["position_mm"][59])


def test_rows_are_numbered_and_described_as_lerobot_does(folder):
    assert arrays(folder, "index").tolist() == list(range(79))
    assert arrays(folder, "frame_index").tolist() == [*range(54), *range(25)]
    assert arrays(folder, "episode_index").tolist() == [0] * 54 + [1] * 25
    assert set(arrays(folder, "task_index")) == {0}
    times = (np.arange(54) / 50).astype(np.float32)
    np.testing.assert_array_equal(arrays(folder, "timestamp")[:54].astype(np.float32), times)
    file = pq.ParquetFile(folder / "data/chunk-000/file-000.parquet")
    assert [file.metadata.row_group(n).num_rows for n in range(file.num_row_groups)] == [54, 25]
    info = json.loads((folder / "meta/info.json").read_text())
    told = ("codebase_version", "fps", "total_episodes", "total_frames", "total_tasks", "splits")
    assert [info[name] for name in told] == ["v3.0", 50, 2, 79, 1, {"train": "0:2"}]
    names = [f"{name}_{axis}_{unit}" for name, unit in (("position", "mm"), ("force", "n"))
             for axis in "xyz"] + ["vibration_rms_m_s2"]  # fmt: skip
    state = {"dtype": "float32", "shape": [7], "names": names}
    assert info["features"]["observation.state"] == state
    schema = read(folder, "data/chunk-000/file-000.parquet").schema
    assert schema.names == list(info["features"])
    assert schema.field("observation.state").type == pa.list_(pa.float32(), 7)
    tasks = [{"task_index": 0, "task": "stroke oak"}]
    assert read(folder, "meta/tasks.parquet").to_pylist() == tasks
    episodes = read(folder, "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    span = ("episode_index", "tasks", "length", "dataset_from_index", "dataset_to_index")
    assert [[line[name] for name in span] for line in episodes] == [
        [0, ["stroke oak"], 54, 0, 54],
        [1, ["stroke oak"], 25, 54, 79],
    ]


def test_statistics_are_those_of_the_rows(folder):
    stats = json.loads((folder / "meta/stats.json").read_text())
    line = read(folder, "meta/episodes/chunk-000/file-000.parquet").to_pylist()[1]
    felt = arrays(folder, "observation.environment_state")
    np.testing.assert_array_equal(felt, arrays(folder, "observation.state")[:, 3:])
    assert set(stats) == set(json.loads((folder / "meta/info.json").read_text())["features"])
    state = arrays(folder, "observation.state")
    for values, figures in (
        (state, stats["observation.state"]),
        (state[54:], {n: line[f"stats/observation.state/{n}"] for n in stats["action"]}),
    ):
        assert figures["count"] == [len(values)]
        for name in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(figures[name], getattr(np, name)(values, axis=0), rtol=1e-5)
        for name in ("q01", "q10", "q50", "q90", "q99"):
            expected = np.quantile(values, int(name[1:]) / 100, axis=0)
            np.testing.assert_allclose(figures[name], expected, rtol=1e-5)


@pytest.mark.parametrize("fps", [1, 30, 60, 1000])
def test_any_rate_shares_out_all_frames(fps):
    rows = low_rate_rows(session_of(2007), fps)
    counts = rows["mmt.frames"]
    assert len(counts) == 2007 * fps // 1000
    assert counts.sum() == int(np.ceil(len(counts) * 1000 / fps))
    assert counts.max() - counts.min() <= 1


@pytest.mark.parametrize(
    ("channels", "width", "acts"),
    [
        (("position",), 3, True),
        (("force", "acceleration"), 4, False),
        (("acceleration",), 1, False),
        (("force", "acceleration", "orientation"), 8, False),
    ],
)
def test_a_session_with_few_channels_has_few_columns(tmp_path, channels, width, acts):
    session = session_of(60, channels=channels)
    export_lerobot([session], tmp_path / "set")
    state = arrays(tmp_path / "set", "observation.state")
    assert state.reshape(3, -1).shape == (3, width)
    if "orientation" in channels:
        np.testing.assert_array_equal(state[:, 3:7], session.frames["orientation"][19::20])
    features = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert ("action" in features) == acts
    back = read_session(tmp_path / "set")
    np.testing.assert_array_equal(back.frames, session.frames)


def with_nan():
    session = session_of(100)
    session.frames["force_n"][59, 1] = np.nan
    return session


@pytest.mark.parametrize(
    ("made", "options", "said"),
    [
        ([], {}, "there is no session"),
        ([session_of(19)], {}, "its 19 frames make no row of 20 ms"),
        ([session_of(0)], {}, "its 0 frames make no row"),
        ([session_of(40), session_of(40, channels=("force",))], {}, "the sessions before it other"),
        ([session_of(40, steps=[600_001] * 39)], {}, "600 s of frames are missing in one place"),
        ([with_nan()], {}, r"a value at 0\.040 s is not finite"),
        ([session_of(40)], {"fps": 0}, "must be 1 to 1000"),
        ([session_of(40)], {"fps": 1001}, "must be 1 to 1000"),
        ([session_of(40)], {"task": " "}, "--task"),
    ],
)
def test_what_makes_no_data_set_is_said_and_leaves_nothing(tmp_path, made, options, said):
    with pytest.raises(InputError, match=said):
        export_lerobot(made, tmp_path / "set", **options)
    assert not list(tmp_path.iterdir())


def test_only_a_data_set_is_replaced_only_when_asked_and_whole(tmp_path, folder, monkeypatch):
    with pytest.raises(InputError, match="it exists already"):
        export_lerobot([session_of(40)], folder)
    with monkeypatch.context() as full:
        full.setattr(pq, "write_table", Mock(side_effect=OSError(28, "No space left on device")))
        with pytest.raises(MmtError, match="No space left"):
            export_lerobot([session_of(40)], folder, replace=True)
    assert len(arrays(folder, "index")) == 79
    export_lerobot([session_of(40)], folder, replace=True)
    assert len(arrays(folder, "index")) == 2
    assert not (folder / "mmt/episode-000001.parquet").exists()
    other = tmp_path / "other"
    other.mkdir()
    export_lerobot([session_of(40)], other)  # an empty folder
    shutil.rmtree(other / "meta")
    with pytest.raises(InputError, match="it exists already"):
        export_lerobot([session_of(40)], other, replace=True)
    with pytest.raises(InputError, match=r"cannot write .*nowhere"):
        export_lerobot([session_of(40)], tmp_path / "nowhere" / "set")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "set"]


@pytest.mark.parametrize("episode", [0, 1, None])
def test_an_episode_comes_back_to_the_bit(folder, sessions, episode):
    session, report = import_recording(folder, ImportOptions(episode=episode))
    made = sessions[episode or 0]
    assert session.frames.dtype == made.frames.dtype
    assert session.frames.tobytes() == made.frames.tobytes()
    assert (session.scene, session.annotations) == (made.scene, made.annotations)
    assert list(session.events) == list(made.events)
    assert report.channels[0].missing_rows == (0 if episode == 1 else 59)
    told = "this is episode 0 of 2; --episode takes another"
    assert (told in report.warnings) == (episode is None)
    assert not propose(folder).options.columns


def test_rows_are_imported_by_their_names(folder, sessions):
    shutil.rmtree(folder / "mmt")
    proposal = propose(folder)
    assert proposal.options.columns == {
        **{f"position_{a}": f"observation.state.position_{a}_mm" for a in "xyz"},
        **{f"force_{a}": f"observation.state.force_{a}_n" for a in "xyz"},
    }
    assert proposal.lacking == ("acceleration",)
    session, report = import_recording(
        folder, ImportOptions(proposal.options.columns, proposal.options.units, episode=1)
    )
    assert session.channels == ("position", "force")
    assert len(session.frames) == 481
    rows = session.frames[::20]
    np.testing.assert_allclose(rows["position_mm"], sessions[1].frames["position_mm"][19:500:20])
    assert report.channels[0].rate_hz == pytest.approx(50.0)


def foreign(folder, features, rows, **info):
    """Write a data set as other programs do, with rows over two files."""
    (folder / "meta").mkdir(parents=True)
    content = {"codebase_version": "v3.0", "fps": 10, "total_episodes": 1, **info}
    (folder / "meta/info.json").write_text(json.dumps({"features": features, **content}))
    half = len(rows["timestamp"]) // 2
    for chunk, part in enumerate((slice(None, half), slice(half, None))):
        table = pa.table({name: values[part] for name, values in rows.items()})
        file = folder / f"data/chunk-000/file-{chunk:03}.parquet"
        file.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, file)


def test_a_data_set_of_another_program_is_read(tmp_path):
    count = 20
    rows = {
        "action": [[0.0, 0.0, 0.0]] * count,
        "observation.state": [[n / 1000, 2 * n / 1000, 0.0] for n in range(count)],
        "wrench": pa.array([[0.0, 0.0, 1.0]] * count, pa.list_(pa.float64(), 3)),
        "frame_index": np.arange(count),
        "timestamp": (np.arange(count) / 10 + 1e-5).astype(np.float32),
        "episode_index": np.zeros(count, dtype=np.int64),
    }
    motors = {"dtype": "float32", "shape": [3], "names": {"motors": ["ee.x", "ee.y", "ee.z"]}}
    features = {
        "observation.images.top": {"dtype": "video", "shape": [3, 4, 4], "names": None},
        "action": motors,
        "observation.state": motors,
        "wrench": {"dtype": "float64", "shape": [3], "names": None},
    }
    foreign(tmp_path / "set", features, rows)
    proposal = propose(tmp_path / "set")
    assert "observation.images.top" not in proposal.names
    # what was measured, before what was commanded
    assert proposal.options.columns["position_y"] == "observation.state.ee.y"
    columns = {**proposal.options.columns, "force": "wrench"}
    session = import_session(tmp_path / "set", columns=columns, units={"position": "m"})
    frames = session.frames
    assert len(frames) == 1901
    np.testing.assert_allclose(frames["position_mm"][:, 0], np.linspace(0, 19, 1901), atol=1e-4)
    np.testing.assert_allclose(frames["force_n"], [[0, 0, 1]] * 1901, atol=1e-6)


@pytest.mark.parametrize(
    ("info", "said"),
    [
        ({"codebase_version": "v1.6"}, r"its format is v1\.6, read are v2\.0, v2\.1, v3\.0"),
        ({"fps": 0}, "has no rate"),
        ({"total_episodes": "many"}, "is not that of a LeRobot data set"),
    ],
)
def test_a_data_set_that_cannot_be_read_is_explained(tmp_path, info, said):
    foreign(tmp_path / "set", {}, {"timestamp": [0.0, 0.1]}, **info)
    with pytest.raises(InputError, match=said):
        import_session(tmp_path / "set")


@settings(max_examples=25)
@given(data=st.data())
def test_an_edited_data_set_gives_the_frames_of_its_rows_or_none(tmp_path_factory, data):
    """As other tools delete, number, order and split episodes, and as disks leave files."""
    folder = tmp_path_factory.mktemp("edited") / "set"
    made = [session_of(n, seed=seed) for seed, n in enumerate((100, 120, 120, 140))]
    export_lerobot(made, folder)
    file = folder / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    kept = data.draw(st.permutations(range(4)).map(tuple))[: data.draw(st.integers(1, 4))]
    numbers = range(len(kept)) if data.draw(st.booleans(), "numbered anew") else kept
    file.unlink()
    damaged = data.draw(st.sampled_from([None, *kept]), "damaged")
    for place, (episode, number) in enumerate(zip(kept, numbers, strict=True)):
        rows = table.filter(pc.equal(table["episode_index"], episode))
        rows = rows.take(
            list(data.draw(st.sampled_from([range(len(rows)), range(len(rows))[::-1]])))
        )
        at = rows.schema.get_field_index("episode_index")
        rows = rows.set_column(at, rows.schema.field(at), pa.array([number] * len(rows)))
        part = file.with_name(f"file-{place:03}.parquet")
        pq.write_table(rows, part)
        part.with_name(f"._{part.name}").write_bytes(b"Mac OS X")
        if episode == damaged:
            part.write_bytes(part.read_bytes()[:-40])
    for episode, number in zip(kept, numbers, strict=True):
        options = ImportOptions(episode=number)
        if episode == damaged:
            with pytest.raises(InputError, match="was left out: this is not a Parquet file"):
                import_recording(folder, options)
        elif episode == number:
            frames = import_recording(folder, options)[0].frames
            assert frames.tobytes() == made[episode].frames.tobytes()
        else:
            with pytest.raises(InputError, match=r"is not of these rows .*: the rows alone"):
                import_recording(folder, options)
            columns = {f"position_{a}": f"action[{n}]" for n, a in enumerate("xyz")}
            session, report = import_recording(folder, ImportOptions(columns, episode=number))
            newest = made[episode].frames["position_mm"][39::20]
            np.testing.assert_allclose(session.frames["position_mm"][:-1:20], newest, rtol=1e-6)
            assert damaged is None or any("left out" in said for said in report.warnings)


@pytest.mark.parametrize("fps", [0.5, 2.5, 1e30])
def test_frames_are_not_compared_with_rows_of_a_rate_that_has_none(folder, sessions, fps):
    file = folder / "meta/info.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "fps": fps}))
    rows = read_columns(folder, bool)
    assert any("(nothing can be compared): the rows alone were read" in n for n in rows.notes)


@given(numbers=st.sets(st.integers(0, 40), min_size=1))
def test_episodes_are_listed_as_ranges(numbers):
    said = _ranges(sorted(numbers))
    shown = []
    for text in said.removesuffix(", ...").split(", "):
        first, _, last = text.partition(" to ")
        shown += range(int(first), int(last or first) + 1)
    assert shown == sorted(numbers)[: len(shown)]
    assert said.endswith("...") == (len(shown) < len(numbers))


def test_damage_and_wrong_episodes_are_explained(tmp_path, folder):
    with pytest.raises(InputError, match="--episode 2: its episodes are 0 to 1"):
        import_recording(folder, ImportOptions(episode=2))
    np.savez(tmp_path / "run.npz", time_s=np.arange(3.0), force_n=np.ones((3, 3)))
    with pytest.raises(InputError, match="--episode 0: it has no such episode or trial"):
        import_recording(tmp_path / "run.npz", ImportOptions(episode=0))
    (folder / "mmt/episode-000000.parquet").write_bytes(b"PAR1 and then nothing")
    with pytest.raises(InputError, match="this is not a Parquet file"):
        import_session(folder)
    shutil.rmtree(folder / "data")
    with pytest.raises(InputError, match="there is no file in"):
        import_session(folder, columns={"position": "action"})
    (folder / "meta/info.json").write_text("{")
    with pytest.raises(InputError, match="is not that of a LeRobot data set"):
        import_session(folder)


def test_a_table_of_another_program_is_read(tmp_path):
    count = 30
    table = {
        "t": np.arange(count) / 1000,
        "tcp.pos": [[n / 10, 0.0, 0.0] for n in range(count)],
        "fz": pa.array([None if n == 5 else 1.0 for n in range(count)], pa.float32()),
        "note": ["stroke"] * count,
        "uneven": [[0.0] * (n % 2) for n in range(count)],
        "lacking": [None if n == 1 else [0.0, 0.0, 0.0] for n in range(count)],
    }
    path = tmp_path / "mine.parquet"
    pq.write_table(pa.table(table), path)
    for columns, said in (
        ({"force_z": "fz", "force_x": "0", "force_y": "0"}, "force_z is empty or NaN in row 5"),
        ({"position_x": "note"}, "note does not hold numbers"),
        ({"position": "uneven"}, "are not all of one length"),
        ({"position": "lacking"}, "position_x is empty or NaN in row 1"),
    ):
        with pytest.raises(InputError, match=said):
            import_session(path, columns={"time": "t", **columns})
    session = import_session(path, columns={"time": "t", "position": "tcp.pos"})
    np.testing.assert_allclose(session.frames["position_mm"][:, 0], np.arange(count) / 10)


def test_what_is_no_parquet_file_of_a_session_is_said(tmp_path):
    (tmp_path / "mine.parquet").write_bytes(b"nothing")
    with pytest.raises(InputError, match="this is not a Parquet file"):
        read_session(tmp_path / "mine.parquet")
    with pytest.raises(InputError, match="No such file"):
        read_session(tmp_path / "none.parquet")
    for count in range(2):
        export_session(session_of(count), tmp_path / "few.parquet")
        with pytest.raises(InputError, match=f"it holds {count} frames, at least 2 are needed"):
            read_session(tmp_path / "few.parquet")


def test_a_table_with_a_sessions_columns_and_a_text_is_read(tmp_path):
    columns = {"sequence": np.arange(50), "time_ns": np.arange(50) * 1_000_000}
    columns |= {"time_s": np.arange(50) / 1000, "trial": ["warm-up"] * 50}
    columns |= {f"force_{axis}_n": np.arange(50) / 10.0 for axis in "xyz"}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    frames = import_session(tmp_path / "a.parquet").frames
    np.testing.assert_allclose(frames["force_n"][:, 1], columns["force_y_n"], rtol=1e-6)


COUNT = 40
INDEX = {"frame_index": np.arange(COUNT), "episode_index": np.zeros(COUNT, dtype=np.int64)}
INDEX["timestamp"] = (INDEX["frame_index"] / 10).astype(np.float32)
STATE_ROWS = {**INDEX, "state": [[float(row), 2.0 * row, 0.0] for row in range(COUNT)]}


def state_feature(names, shape=(3,)):
    return {"state": {"dtype": "float32", "shape": list(shape), "names": names}}


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0"])
@pytest.mark.parametrize(
    "changed",
    [
        {"timestamp": np.arange(COUNT) / 10 + 1.765e9},
        {"frame_index": np.zeros(COUNT, dtype=int)},
        {name: [[value] for value in INDEX[name].tolist()] for name in INDEX},
    ],
)
@pytest.mark.parametrize("episodes", [0, 1])
def test_rows_are_found_by_whatever_numbers_them(tmp_path, version, changed, episodes):
    info = {"codebase_version": version, "total_episodes": episodes}
    foreign(tmp_path / "set", state_feature(["x", "y", "z"]), {**STATE_ROWS, **changed}, **info)
    told = tmp_path / "set/meta/info.json"
    told.write_text("\ufeff" + told.read_text())
    read = read_columns(tmp_path / "set", bool)
    np.testing.assert_array_equal(read.values["state.y"], 2.0 * np.arange(COUNT))
    time_s = read.times["state.y"]
    np.testing.assert_allclose(time_s - time_s[0], np.arange(COUNT) / 10, atol=1e-6)
    assert read.notes == []


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["x", "y", "z"], ["x", "y", "z"]),
        ({"z": 2, "x": 0, "y": 1}, ["x", "y", "z"]),
        ({"motors": ["x", "y"], "gripper": ["z"]}, ["x", "y", "z"]),
        ({"left": ["z"], "right": ["z"], "both": ["x"]}, ["z.1", "z.2", "x"]),
        (["arm"], []),
        (["w", "x", "y", "z"], []),
        (None, []),
    ],
)
def test_components_have_their_names_or_none(tmp_path, names, found):
    foreign(tmp_path / "set", state_feature(names), STATE_ROWS)
    read = read_columns(tmp_path / "set", bool)
    assert [name for name in read.names if name != "state"] == [f"state.{name}" for name in found]
    for place, name in enumerate(found):
        np.testing.assert_array_equal(read.values[f"state.{name}"], read.values["state"][:, place])
    assert len(read.notes) == (names is not None and not found)


def test_lists_within_lists_stay_in_their_row(tmp_path):
    pads = [[[row, 1.0], [2.0, 3.0], [4.0, 5.0]] for row in range(COUNT)]
    feature = {"pads": {"dtype": "float32", "shape": [3, 2], "names": ["taxel", "axis"]}}
    foreign(tmp_path / "set", feature, {**INDEX, "pads": pads})
    read = read_columns(tmp_path / "set", bool)
    np.testing.assert_array_equal(read.values["pads"], np.reshape(pads, (COUNT, 6)))


@pytest.mark.parametrize("other", [1.0, 0.0])
@pytest.mark.parametrize("rows", [COUNT, 7])
def test_recordings_of_one_number_are_never_mixed(tmp_path, other, rows):
    foreign(tmp_path / "set", state_feature(None), STATE_ROWS)
    again = {name: values[:rows] for name, values in STATE_ROWS.items()}
    again["state"] = [[x + other, y, z] for x, y, z in again["state"]]
    pq.write_table(pa.table(again), tmp_path / "set/data/chunk-000/file-009.parquet")
    columns = {"position": "state"}
    if other:
        with pytest.raises(InputError, match=rf"{rows} rows have the frame_index of another row"):
            import_session(tmp_path / "set", columns=columns, longest_gap_s=1.0)
    else:
        frames = import_session(tmp_path / "set", columns=columns, longest_gap_s=1.0).frames
        np.testing.assert_allclose(frames["position_mm"][::100, 0], np.arange(COUNT), atol=1e-6)


def test_a_file_of_other_columns_costs_its_own_episodes(tmp_path):
    feature = {**state_feature(None), "absent": {"dtype": "float32", "shape": [1], "names": None}}
    foreign(tmp_path / "set", feature, STATE_ROWS)
    other = {**INDEX, "episode_index": np.full(COUNT, 1)}
    pq.write_table(pa.table(other), tmp_path / "set/data/chunk-000/file-000-.parquet")
    assert read_columns(tmp_path / "set", bool).names == ["state"]
    assert read_columns(tmp_path / "set", bool, ImportOptions(episode=1)).names == []
    del other["episode_index"]
    pq.write_table(pa.table(other), tmp_path / "set/data/chunk-000/file-009.parquet")
    notes = read_columns(tmp_path / "set", bool).notes
    left = "data/chunk-000/file-009.parquet was left out: it has no column episode_index"
    assert left in [note.replace("\\", "/") for note in notes]


def test_timestamps_of_another_rate_are_said(tmp_path):
    foreign(tmp_path / "set", state_feature(None), STATE_ROWS, fps=30, total_episodes=4)
    counted, rate = read_columns(tmp_path / "set", bool).notes
    assert "counts 4 episodes, 1 are here" in counted
    assert "0.1 s apart by their timestamps, which were taken, and 0.03333 s by" in rate
