"""Bags that were cut off, lost their description, or were compressed: what is whole is read."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from hypothesis import event, example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from mmt.core.errors import InputError
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.recording import read_columns

pytestmark = pytest.mark.usefixtures("read_here")

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="needs the extra 'import'")
rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra 'import'")
zstandard = pytest.importorskip("zstandard")

BEGAN_NS = 1_765_000_000_000_000_000
STEP_NS = 2_000_000
ROWS = 400
KIND = "geometry_msgs/msg/WrenchStamped"
FORCE = "/ft.wrench.force"
FORCES = np.random.default_rng(4).normal(size=(ROWS, 3))


def messages(store):
    """Yield times and messages of `KIND`."""
    kinds = store.types
    seq = {"seq": 0} if "seq" in kinds["std_msgs/msg/Header"].__annotations__ else {}
    zero = kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    for row, force in enumerate(FORCES):
        at_ns = BEGAN_NS + row * STEP_NS
        stamp = kinds["builtin_interfaces/msg/Time"](at_ns // 10**9, at_ns % 10**9)
        header = kinds["std_msgs/msg/Header"](**seq, stamp=stamp, frame_id="")
        vector = kinds["geometry_msgs/msg/Vector3"](*force)
        yield at_ns, kinds[KIND](header, kinds["geometry_msgs/msg/Wrench"](vector, zero))


def write_bag(folder, storage, mode=None):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    writer = rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if mode:
        writer.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/ft", KIND, typestore=store)
        for at_ns, message in messages(store):
            writer.write(connection, at_ns, store.serialize_cdr(message, KIND))


def write_ros1(path, compression):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        connection = writer.add_connection("/ft", KIND, typestore=store)
        for at_ns, message in messages(store):
            writer.write(connection, at_ns, store.serialize_ros1(message, KIND))


def check_whole(path):
    columns = read_columns(path, bool)
    np.testing.assert_array_equal(columns.values[FORCE], FORCES)
    np.testing.assert_allclose(columns.times[FORCE], np.arange(ROWS) * STEP_NS / 1e9, atol=1e-9)
    return columns.notes


def zipped_messages(path):
    """Compress each message of an MCAP file, as a recorder does in the mode MESSAGE."""
    with path.open("rb") as stream:
        found = list(make_reader(stream).iter_messages())
    schema, channel, _ = found[0]
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        number = writer.register_schema(schema.name, schema.encoding, schema.data)
        number = writer.register_channel(channel.topic, channel.message_encoding, number)
        for _, _, each in found:
            data = zstandard.compress(each.data)
            writer.add_message(number, each.log_time, data, each.publish_time)
        writer.finish()


def rename_others(told):
    for file in sorted(told.parent.iterdir()):
        if file != told:
            file.rename(file.with_name(f"renamed_{file.name}"))


DAMAGE = {
    "removed": lambda told: told.unlink(),
    "empty": lambda told: told.write_bytes(b""),
    "newer": lambda told: told.write_text("version: 99"),
    "of other files": rename_others,
}


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("mode", [None, "MESSAGE", "FILE"])
def test_a_bag_needs_no_description(tmp_path, storage, damage, mode):
    folder = tmp_path / "bag"
    write_bag(folder, storage, mode if storage == "SQLITE3" else None)
    (file,) = folder.glob("bag*")
    if storage == "MCAP" and mode == "MESSAGE":
        zipped_messages(file)
    elif storage == "MCAP" and mode == "FILE":
        file.with_name(f"{file.name}.zstd").write_bytes(zstandard.compress(file.read_bytes()))
        file.unlink()
    DAMAGE[damage](folder / "metadata.yaml")
    assert check_whole(folder) == []


@settings(max_examples=25, deadline=None)
@given(share=st.floats(0.02, 0.98), kind=st.sampled_from(["db3", None, "BZ2", "LZ4"]))
@example(share=0.7572867161784663, kind=None)  # between two records of a chunk
def test_a_bag_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path_factory, share, kind):
    folder = tmp_path_factory.mktemp("cut")
    if kind == "db3":
        write_bag(folder / "bag", "SQLITE3")
        (path,) = (folder / "bag").glob("*.db3")
    else:
        path = folder / "a.bag"
        write_ros1(path, kind)
    assert check_whole(path) == []
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    try:
        columns = read_columns(path, bool)
    except InputError:
        event("nothing is left")
        return
    found = columns.values.get(FORCE, np.zeros((0, 3)))
    np.testing.assert_array_equal(found, FORCES[: len(found)])
    event(f"{len(found) * 10 // ROWS} tenths are left")
    assert len(found) == ROWS or columns.notes


def test_what_a_killed_recorder_left_in_the_journal_is_read(tmp_path):
    write_bag(tmp_path / "bag", "SQLITE3")
    (path,) = (tmp_path / "bag").glob("*.db3")
    stored = sqlite3.connect(path)
    stored.execute("PRAGMA journal_mode = wal")
    rows = stored.execute("SELECT topic_id, timestamp, data FROM messages").fetchall()
    stored.execute("DELETE FROM messages WHERE id > 150")
    stored.commit()
    stored.execute("PRAGMA wal_checkpoint(truncate)")
    stored.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows[150:]
    )
    stored.commit()
    before = {file.name: file.read_bytes() for file in path.parent.iterdir()}
    assert check_whole(tmp_path / "bag") == []
    assert {file.name: file.read_bytes() for file in path.parent.iterdir()} == before
    stored.close()


@pytest.mark.parametrize("content", [b"", b"version https://git-lfs.github.com/spec/v1\noid", b"?"])
@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_a_file_of_several_that_cannot_be_read_costs_itself_alone(tmp_path, storage, content):
    write_bag(tmp_path / "bag", storage)
    (file,) = (tmp_path / "bag").glob("bag*")
    other = file.with_stem("other")
    other.write_bytes(content)
    (note,) = check_whole(tmp_path / "bag")
    assert note.startswith(other.name)
    assert note.endswith("; it was left out")
    assert ("git lfs pull" in note) == (b"lfs" in content)
    file.unlink()
    with pytest.raises(InputError, match="bag"):
        read_columns(tmp_path / "bag", bool)


def test_topics_of_one_name_are_told_apart(tmp_path):
    write_bag(tmp_path / "bag", "SQLITE3")
    (path,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as stored, stored:
        of_first = ", ".join(each[1] for each in stored.execute("PRAGMA table_info(topics)"))
        others = of_first.replace("id", "id + 1", 1)
        stored.execute(f"INSERT INTO topics ({of_first}) SELECT {others} FROM topics")
        stored.execute("UPDATE messages SET topic_id = topic_id + 1 WHERE id % 2 = 0")
    columns = read_columns(path, bool)
    for place, name in enumerate(("/ft@1.wrench.force", "/ft@2.wrench.force")):
        np.testing.assert_array_equal(columns.values[name], FORCES[place::2])


def test_lost_files_of_a_bag_are_said(tmp_path):
    write_bag(tmp_path / "bag", "MCAP")
    told = tmp_path / "bag" / "metadata.yaml"
    told.write_text(told.read_text().replace("  - bag.mcap", "  - bag.mcap\n  - bag_1.mcap", 1))
    assert check_whole(tmp_path / "bag") == [
        "the bag has 2 files by its metadata.yaml, of which 1 are here"
    ]


def test_nodes_of_ros1_are_told_apart_not_their_connections(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    for names, sources in (("aa", 1), ("ab", 2)):
        with rosbag1.Writer(tmp_path / f"{names}.bag") as writer:
            made = [
                writer.add_connection("/ft", KIND, typestore=store, callerid=name, latching=place)
                for place, name in enumerate(names)
            ]
            for row, (at_ns, message) in enumerate(messages(store)):
                data = store.serialize_ros1(message, KIND)
                writer.write(made[row > ROWS // 2], at_ns, data)
        names_read = read_columns(tmp_path / f"{names}.bag", bool).names
        assert sum(name.endswith(".wrench.force") for name in names_read) == sources


def test_clocks_of_two_machines_are_said(tmp_path):
    """Only the person can know whether a header is late, or its message."""
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("demo/Value", "jsonschema", b"{}")
        for topic, late_ns in (("/a", 300_000), ("/b", 800_000_000)):
            channel = writer.register_channel(topic, "json", schema)
            for row in range(ROWS):
                at_ns = BEGAN_NS + row * STEP_NS
                data = b'{"timestamp": %d, "v": 1}' % at_ns
                writer.add_message(channel, at_ns + late_ns, data, at_ns)
        writer.add_message(channel, (1 << 64) - 1, b'{"timestamp": 0, "v": 1}', 0)
        writer.finish()
    impossible, clocks = read_columns(tmp_path / "a.mcap", bool, ImportOptions()).notes
    assert "1 messages with impossible times were left out" in impossible
    assert "0.3 ms (/a) to 800 ms (/b), as if their headers were of two clocks" in clocks
