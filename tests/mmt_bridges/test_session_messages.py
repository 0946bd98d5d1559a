"""Messages of other programs in MCAP files: any encoding, several publishers, clocks, damage."""

import json
import struct
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType, Writer

from mmt.core.errors import InputError
from mmt.session.files import import_session
from mmt.session.importing.columns import Wanted
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose
from mmt.session.importing.recording import import_recording, read_columns
from mmt.session.mcap.messages import message_class
from mmt_bridges.ros.clocks import SourceStamps

pytestmark = pytest.mark.usefixtures("read_here")

pytest.importorskip("rosbags", reason="needs the extra 'import'")

BEGAN_NS = 1_765_000_000_000_000_000
ROWS = 60
STEP_NS = 2_000_000


def write(path, channels, rows=range(ROWS)):
    """Write rows of channels (topic, schema, its encoding, encoding, messages) of one rate."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4096)
        writer.start()
        numbers = []
        for topic, (kind, encoding, data), message_encoding, _ in channels:
            schema = writer.register_schema(kind, encoding, data)
            numbers.append(writer.register_channel(topic, message_encoding, schema))
        for row in rows:
            for number, (*_, messages) in zip(numbers, channels, strict=True):
                at_ns = BEGAN_NS + row * STEP_NS
                writer.add_message(number, at_ns, messages[row], at_ns)
        writer.finish()


def packed(values):
    return [json.dumps(value).encode() for value in values]


def wrench(forces, stamps_ns, frames):
    return packed(
        {
            "header": {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame},
            "wrench": {"force": dict(zip("xyz", force, strict=True))},
            "raw": [*force, 7.0],
        }
        for force, ns, frame in zip(forces, stamps_ns, frames, strict=True)
    )


def read_json(path, topic, values):
    """Return the columns of a file with a topic of JSON."""
    write(path, [(topic, JSON, "json", packed(values))])
    return read_columns(path, bool)


def protobuf(name, *fields, either=()):
    """Return the schema of a message with numbers, of which some exclude each other."""
    from google.protobuf import descriptor_pb2

    file = descriptor_pb2.FileDescriptorProto(name=f"{name}.proto", syntax="proto3")
    body = file.message_type.add(name=name)
    if either:
        body.oneof_decl.add(name="payload")
    for number, field in enumerate((*either, *fields), start=1):
        choice = {"oneof_index": 0} if field in either else {}
        body.field.add(name=field, number=number, type=1, label=1, **choice)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


JSON = ("demo/Wrench", "jsonschema", b"{}")
FORCES = np.random.default_rng(3).normal(size=(ROWS, 3))


@settings(max_examples=10)
@given(data=st.data())
def test_sources_keep_their_values_and_have_one_clock(tmp_path_factory, data):
    """Publishers by channel and frames within one, with headers of any clock."""
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    clocks = st.sampled_from(["utc", "uptime", "none", "some", "first"])
    count = data.draw(st.integers(1, 3), "channels")
    frames = data.draw(st.lists(st.sampled_from(["", "left", "right"]), min_size=1, max_size=2))
    chosen = [data.draw(clocks) for _ in range(count)]
    received = BEGAN_NS + STEP_NS * np.arange(ROWS)
    channels, expected = [], {}
    for place, clock in enumerate(chosen):
        stamps = {
            "utc": received - 300_000,
            "uptime": received - BEGAN_NS + 5_000_000_000,
            "none": np.zeros(ROWS, dtype=int),
            "first": np.full(ROWS, BEGAN_NS),
            "some": np.where(np.arange(ROWS) % 4, received - 300_000, 0),
        }[clock].tolist()
        values = FORCES + place
        of_rows = [frames[row % len(frames)] for row in range(ROWS)]
        channels.append(("/ft", JSON, "json", wrench(values, stamps, of_rows)))
        for frame in dict.fromkeys(frames):
            rows = [row for row in range(ROWS) if of_rows[row] == frame]
            expected[place, frame] = (values[rows], np.array(stamps)[rows], received[rows])
    write(path, channels)
    names = {name for name in read_columns(path, bool).names if ".wrench.force" in name}
    assert len(names) == len(expected)
    alike = set(chosen) in ({"utc"}, {"uptime"})
    read = read_columns(path, bool)
    left = list(expected.values())
    for name in names:
        values = read.values[name]
        (of,) = [each for each in left if np.array_equal(each[0], values)]
        times_ns = of[1] if alike else of[2]
        first = min(each[1 if alike else 2][0] for each in left)
        np.testing.assert_allclose(read.times[name], (times_ns - first) / 1e9, atol=1e-9)
        np.testing.assert_array_equal(read.values[name.replace("wrench.force", "raw")][:, 3], 7.0)
    told = any("times are those of" in note for note in read.notes)
    assert told == (set(chosen) != {"none"})
    if not alike:
        with pytest.raises(InputError, match="--stamps header: "):
            read_columns(path, bool, ImportOptions(stamps="header"))
    if len(names) > 1:
        with pytest.raises(InputError, match="which is not there"):
            import_session(path, columns={"force": "/ft"})


def test_protobuf_joints_and_what_cannot_be_decoded(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    name = "sensor_msgs/msg/JointState"
    stamp = store.types["builtin_interfaces/msg/Time"](0, 0)
    header, none = store.types["std_msgs/msg/Header"](stamp, ""), np.array([])
    states = (
        store.types[name](header, ["a", "b"], np.array([row, 2.0 * row]), none, none)
        for row in range(ROWS)
    )
    joints = [store.serialize_cdr(state, name) for state in states]
    schema = protobuf("Force", *"xyz")
    made = message_class(schema, "Force")
    forces = [made(**dict(zip("xyz", f, strict=True))).SerializeToString() for f in FORCES]
    path = tmp_path / "a.mcap"
    write(
        path,
        [
            ("/force", ("Force", "protobuf", schema), "protobuf", forces),
            ("/joints", (name, "ros2msg", b""), "cdr", joints),
            ("/arm", ("vendor_msgs/msg/Arm", "ros2msg", b""), "cdr", [bytes(44)] * ROWS),
            ("/text", JSON, "json", [b"{"] * ROWS),
        ],
    )
    whole = read_columns(path, bool)
    np.testing.assert_array_equal(whole.values["/joints.position.b"], 2.0 * np.arange(ROWS))
    assert whole.values["/joints.position"].shape == (ROWS, 2)
    assert sum("cannot be read and were left out" in note for note in whole.notes) == 2
    for cut in (1.0, 0.6):
        path.write_bytes(path.read_bytes()[: int(cut * path.stat().st_size)])
        session, report = import_recording(path, ImportOptions({"force": "/force"}))
        found = session.frames["force_n"][::2]
        assert len(found) > ROWS / 4
        np.testing.assert_allclose(found, FORCES[: len(found)], rtol=1e-6)
        assert sum("what is whole was read" in said for said in report.warnings) == (cut < 1)


@given(
    plain=st.fixed_dictionaries(
        dict.fromkeys(("use_chunking", "use_statistics", "enable_crcs"), st.booleans())
    ),
    indexed=st.sampled_from([IndexType.NONE, IndexType.CHUNK, IndexType.ALL]),
    lost=st.booleans(),
)
@settings(max_examples=15)
def test_only_what_is_lost_is_said_and_once(tmp_path_factory, plain, indexed, lost):
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=512, index_types=indexed, **plain)
        writer.start()
        schema = writer.register_schema("demo/Value", "jsonschema", b"{}")
        channel = writer.register_channel("/value", "json", schema)
        for row in range(ROWS):
            writer.add_message(channel, BEGAN_NS + row, b'{"v": 1.5}', BEGAN_NS + row)
        writer.add_attachment(0, 0, "picture", "image/png", bytes(100))
        writer.finish()
    content = path.read_bytes()
    if lost and plain["use_chunking"]:
        path.write_bytes(b"none".join(content.rsplit(b"\x28\xb5\x2f\xfd", 1)))  # begins a chunk
    columns = read_columns(path, bool)
    if path.read_bytes() == content:
        assert columns.notes == []
        assert len(columns.values["/value.v"]) == ROWS
    else:
        assert columns.notes == ["a.mcap: 1 damaged chunks; what is whole was read"]
        assert 0 < len(columns.values["/value.v"]) < ROWS


@given(order=st.permutations(range(4)))
@settings(max_examples=8)
def test_protobuf_schemas_are_read_in_any_order(tmp_path_factory, order):
    from google.protobuf import descriptor_pb2

    files = []
    for number in range(4):  # each is a member of the next
        file = descriptor_pb2.FileDescriptorProto(name=f"{number}.proto", syntax="proto3")
        body = file.message_type.add(name=f"M{number}")
        if number:
            file.dependency.append(f"{number - 1}.proto")
            body.field.add(name="m", number=1, type=11, label=1, type_name=f".M{number - 1}")
        else:
            body.field.add(name="value", number=1, type=1, label=1)
        files.append(file)
    definition = descriptor_pb2.FileDescriptorSet(file=[files[n] for n in order])
    made = message_class(descriptor_pb2.FileDescriptorSet(file=files).SerializeToString(), "M3")
    messages = [
        made(m={"m": {"m": {"value": float(row)}}}).SerializeToString() for row in range(ROWS)
    ]
    schema = ("M3", "protobuf", definition.SerializeToString())
    path = tmp_path_factory.mktemp("proto") / "a.mcap"
    write(path, [("/deep", schema, "protobuf", messages)])
    whole = read_columns(path, bool)
    assert whole.notes == []
    np.testing.assert_array_equal(whole.values["/deep.m.m.m.value"], np.arange(ROWS))
    files[0].dependency.append("3.proto")
    circle = descriptor_pb2.FileDescriptorSet(file=files).SerializeToString()
    with pytest.raises(InputError, match="the schema of M3 cannot be used"):
        message_class(circle, "M3")


def test_a_schema_in_the_index_alone_is_read(tmp_path):
    """As the C++ library writes the second file of a recorder that splits (foxglove/mcap#1258)."""
    path = tmp_path / "a.mcap"
    definition = protobuf("Value", "value")
    with path.open("wb") as stream:
        plain = {"enable_crcs": False, "enable_data_crcs": False, "use_chunking": False}
        writer = Writer(stream, **plain)
        writer.start()
        number = writer.register_schema("Value", "protobuf", definition)
        number = writer.register_channel("/value", "protobuf", number)
        made = message_class(definition, "Value")
        for row in range(ROWS):
            message = made(value=row).SerializeToString()
            writer.add_message(number, BEGAN_NS + row * STEP_NS, message, 0)
        writer.finish()
    content = bytearray(path.read_bytes())
    content[content.index(b"Value") - 15] = 0x81  # makes a record of another program of it
    path.write_bytes(content)
    columns = read_columns(path, bool)
    np.testing.assert_array_equal(columns.values["/value.value"], np.arange(ROWS))
    assert columns.notes == []


def test_a_folder_without_description_is_read_file_by_file(tmp_path):
    received = (BEGAN_NS + STEP_NS * np.arange(ROWS)).tolist()
    write(tmp_path / "b.mcap", [("/ft", JSON, "json", wrench(FORCES, received, [""] * ROWS))])
    (tmp_path / "._b.mcap").write_bytes(b"Mac OS X")
    frames = import_session(tmp_path, columns={"force": "/ft"}).frames
    np.testing.assert_allclose(frames["force_n"][::2], FORCES, rtol=1e-6)
    (tmp_path / "b.mcap").unlink()
    with pytest.raises(InputError, match=r"no \.mcap, \.db3 or \.bag file in this folder"):
        import_session(tmp_path)


@settings(max_examples=10)
@given(cuts=st.sets(st.integers(1, ROWS - 1), min_size=1, max_size=12), data=st.data())
def test_a_bag_of_several_files_is_one_recording(tmp_path_factory, cuts, data):
    folder = tmp_path_factory.mktemp("bag")
    parts = np.split(np.arange(ROWS), sorted(cuts))
    names = data.draw(st.permutations(range(len(parts))))  # bag_10.mcap stands before bag_2.mcap
    received = (BEGAN_NS + STEP_NS * np.arange(ROWS)).tolist()
    channels = [("/ft", JSON, "json", wrench(FORCES, received, [""] * ROWS))]
    for name, rows in zip(names, parts, strict=True):
        write(folder / f"{name}.mcap", channels, rows.tolist())
    session = import_session(folder, columns={"force": "/ft"})
    np.testing.assert_allclose(session.frames["force_n"][::2], FORCES, rtol=1e-6)
    assert session.began_utc_ns == BEGAN_NS


DATE_S = BEGAN_NS // 10**9 - 1
SECONDS = datetime.fromtimestamp(DATE_S, UTC)


@pytest.mark.parametrize(
    "stamp",
    [
        lambda row: DATE_S + row * STEP_NS / 1e9,
        lambda row: DATE_S * 10**3 + row * STEP_NS / 1e6,
        lambda row: DATE_S * 10**6 + row * STEP_NS / 1e3,
        lambda row: DATE_S * 10**9 + row * STEP_NS,
        lambda row: (SECONDS + timedelta(milliseconds=2 * row)).isoformat(),
    ],
    ids=["s", "ms", "us", "ns", "text"],
)
def test_a_stamp_that_is_a_number_or_a_text_is_a_date(tmp_path, stamp):
    rows = ({"timestamp": stamp(row), "v": row} for row in range(ROWS))
    read = read_json(tmp_path / "a.mcap", "/v", rows)
    np.testing.assert_allclose(read.times["/v.v"], np.arange(ROWS) * STEP_NS / 1e9, atol=1e-6)
    assert read.began_utc_ns == pytest.approx(DATE_S * 10**9, abs=1000)
    assert any("times are those of the headers" in note for note in read.notes)


@pytest.mark.parametrize("sensors", ["abc", (1, 2, 3)])
def test_a_topic_that_is_not_asked_for_does_not_choose_the_clock(tmp_path, sensors):
    stamps = [BEGAN_NS + row * STEP_NS - 300_000 for row in range(ROWS)]
    others = packed({"sensor": sensors[row % 3], "value": row} for row in range(ROWS))
    measured = packed({"sensor": 0.1 * row} for row in range(ROWS))
    forces = wrench(FORCES, stamps, [""] * ROWS)
    each = {"/ft": forces, "/others": others, "/load": measured}
    write(tmp_path / "a.mcap", [(topic, JSON, "json", data) for topic, data in each.items()])
    for name, headers in (("/ft.wrench.force", True), ("/load.sensor", False)):
        read = read_columns(tmp_path / "a.mcap", Wanted({"/ft.wrench.force", name}))
        assert ("times are those of the headers" in str(read.notes)) == headers
        assert not any("tells" in note for note in read.notes)
        np.testing.assert_allclose(read.times[name], np.arange(ROWS) * STEP_NS / 1e9, atol=1e-9)


def test_a_field_of_several_shapes_is_refused_with_the_reason(tmp_path):
    shapes = [1.5, {"x": 0, "y": 0, "z": 1.5}]
    read_json(tmp_path / "a.mcap", "/ft", ({"force": shapes[row > 9]} for row in range(ROWS)))
    with pytest.raises(InputError, match=r"/ft.force, which has lists of several lengths"):
        import_session(tmp_path / "a.mcap", columns={"force": "/ft.force"})


@settings(max_examples=10)
@given(st.lists(st.permutations("abc"), min_size=ROWS, max_size=ROWS), st.integers(0, ROWS))
def test_lists_keep_the_order_of_their_first_names(tmp_path_factory, orders, others):
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    orders = [*orders[:others], *([["d", "e", "f"]] * (ROWS - others))] or orders
    place = {name: number for number, name in enumerate("abcdef")}
    efforts = ([place[n] + 10 * row for n in order] for row, order in enumerate(orders))
    named = zip(orders, efforts, strict=True)
    read = read_json(path, "/js", ({"name": list(o), "effort": each} for o, each in named))
    first = [place[name] for name in orders[0]]
    rows = np.array([row for row, order in enumerate(orders) if {*order} == {*orders[0]}])
    np.testing.assert_array_equal(read.values["/js.effort"], first + 10 * rows[:, None])
    np.testing.assert_array_equal(read.values[f"/js.effort.{orders[0][0]}"], first[0] + 10 * rows)


@pytest.mark.parametrize("names", [["a", "b", "a"], ["", "", ""], ["a", "", "b"]])
def test_lists_whose_elements_are_not_told_apart_stay_whole(tmp_path, names):
    values = ({"name": names, "effort": [row, 2 * row, 3 * row]} for row in range(ROWS))
    read = read_json(tmp_path / "a.mcap", "/js", values)
    assert list(read.values) == ["/js.effort"]
    np.testing.assert_array_equal(read.values["/js.effort"][:, 1], 2 * np.arange(ROWS))


def test_transforms_are_called_by_their_child(tmp_path):
    moved = ({"x": row, "y": 0, "z": 0} for row in range(ROWS))
    each = (
        {"transforms": [{"child_frame_id": ["tool", "camera"][row % 2], "transform": xyz}]}
        for row, xyz in enumerate(moved)
    )
    values = read_json(tmp_path / "a.mcap", "/tf", each).values
    np.testing.assert_array_equal(values["/tf.transforms.tool.transform"][:, 0] % 2, 0)
    np.testing.assert_array_equal(values["/tf.transforms.camera.transform"][:, 0] % 2, 1)


def test_a_protobuf_field_that_was_not_given_is_no_zero(tmp_path):
    names = ("force", "current")
    schema = protobuf("Sample", "plain", either=names)
    made = message_class(schema, "Sample")
    samples = [made(**{names[row % 2]: float(row)}).SerializeToString() for row in range(ROWS)]
    path = tmp_path / "a.mcap"
    write(path, [("/s", ("Sample", "protobuf", schema), "protobuf", samples)])
    read = read_columns(path, bool)
    for first, name in enumerate(names):
        np.testing.assert_array_equal(read.values[f"/s.{name}"], np.arange(first, ROWS, 2))
    np.testing.assert_array_equal(read.values["/s.plain"], np.zeros(ROWS))


@pytest.mark.parametrize(
    ("kind", "language", "definition"),
    [
        ("demo/Arm", "ros1msg", "int64 n\ndemo/Vec force\n" + "=" * 80 + "\nMSG: demo/Vec\n{}"),
        ("demo/msg/Arm", "ros2msg", "int64 n\nVec force\n" + "=" * 80 + "\nMSG: demo/Vec\n{}"),
        ("demo/msg/Arm", "ros2idl", "{idl}"),
        ("demo/msg/Arm", "ros2idl", "=" * 80 + "\nIDL: demo/msg/Arm\n{idl}"),
        ("demo::msg::Arm", "omgidl", "{idl}"),
    ],
)
def test_definitions_are_read_in_the_language_that_the_file_names(
    tmp_path, kind, language, definition
):
    idl = (
        "module demo { module msg { struct Vec { double x; double y; double z; };"
        " struct Arm { long long n; demo::msg::Vec force; }; }; };"
    )
    vector = "float64 x\nfloat64 y\nfloat64 z\n"
    text = definition.replace("{idl}", idl).replace("{}", vector)
    head, encoding = (b"", "ros1") if language == "ros1msg" else (b"\0\1\0\0", "cdr")
    messages = [head + struct.pack("<q3d", row, *FORCES[row]) for row in range(ROWS)]
    path = tmp_path / "a.mcap"
    write(path, [("/arm", (kind, language, text.encode()), encoding, messages)])
    read = read_columns(path, bool)
    assert read.notes == []
    np.testing.assert_array_equal(read.values["/arm.force"], FORCES)
    np.testing.assert_array_equal(read.values["/arm.n"], np.arange(ROWS))


@given(
    step_s=st.floats(1.5, 50.0).flatmap(lambda s: st.sampled_from([s, -s])),
    row=st.integers(16, ROWS - 16),
    held_s=st.floats(0.0, 30.0),
    lasts=st.booleans(),
)
def test_a_clock_that_is_set_is_told_from_messages_that_are_held_up(step_s, row, held_s, lasts):
    """Headers go on at another time; or messages are received together, after the last of them."""
    header_ns = BEGAN_NS + STEP_NS * np.arange(ROWS)
    received_ns = header_ns + 300_000
    free_ns = received_ns[row] + round(1e9 * held_s)
    received_ns = np.where(np.arange(ROWS) < row, received_ns, np.maximum(received_ns, free_ns))
    if lasts:
        received_ns = header_ns + 300_000
        header_ns[row:] += round(1e9 * step_s)
    else:  # those that are received at last are of after the pause
        header_ns[-16:] = received_ns[-16:] = free_ns + STEP_NS * np.arange(1, 17)
    stamps = SourceStamps("/ft")
    for received, header in zip(received_ns.tolist(), header_ns.tolist(), strict=True):
        stamps.stamp(received, header)
    assert bool(stamps.problem()) == lasts


@pytest.mark.parametrize("seconds", ["1e400", "NaN", '"now"', "-5"])
def test_a_stamp_that_is_no_date_leaves_the_time_of_receipt(tmp_path, seconds):
    text = f'{{"header": {{"stamp": {{"sec": {seconds}}}}}, "v": 1}}'.encode()
    write(tmp_path / "a.mcap", [("/v", JSON, "json", [text] * ROWS)])
    read = read_columns(tmp_path / "a.mcap", bool)
    np.testing.assert_allclose(read.times["/v.v"], np.arange(ROWS) * STEP_NS / 1e9, atol=1e-9)


@pytest.mark.parametrize(
    ("topic", "member", "found"),
    [
        ("/cmd", "twist", None),
        ("/cmd_vel", None, None),
        ("/arm", "accel", "/arm.accel.linear"),
        ("/tool/accel", None, "/tool/accel.linear"),
    ],
)
def test_the_speed_of_a_twist_is_no_acceleration(tmp_path, topic, member, found):
    vectors = {"linear": dict(zip("xyz", FORCES[0], strict=True)), "angular": {"x": 0.0}}
    read_json(tmp_path / "a.mcap", topic, [vectors if member is None else {member: vectors}] * ROWS)
    assert propose(tmp_path / "a.mcap").options.columns.get("acceleration") == found
