"""A file that was cut off or damaged gives back every whole chunk."""

import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from session_samples import made_frames

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.session.data import OutputBlock
from mmt.session.files import read_session, write_session
from mmt.session.info import info
from mmt.session.mcap import scan
from mmt.session.mcap.index import IndexedSession
from mmt.session.mcap.writer import SessionWriter
from mmt.session.recover import recover
from mmt.session.stream import blocks_of, open_recording, open_windows

FLUSH_FRAMES = 500


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A session of ten flushes as a recorder makes it, and the bytes after each flush."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    frames = made_frames(5000)
    ends = []
    with path.open("wb") as stream:
        writer = SessionWriter(stream, CHANNELS, {"session": {"name": "wood"}})
        writer.write_annotations(b"truth", 0)
        for first in range(0, 5000, 20):
            writer.write_frames(frames[first : first + 20], first)
            if (first + 20) % FLUSH_FRAMES == 0:
                writer.write_event('{"event": "flush"}', first)
                writer.write_model(b"npz", first)
                writer.flush()
                ends.append(stream.tell())
        writer.finish()
    return path, frames, ends


@given(data=st.data())
@settings(max_examples=40)
def test_a_cut_costs_at_most_one_flush(tmp_path_factory, whole, data):
    path, frames, ends = whole
    content = path.read_bytes()
    length = data.draw(st.integers(ends[0], len(content) - 1))
    folder = tmp_path_factory.mktemp("cut")
    cut = folder / "cut.mcap"
    cut.write_bytes(content[:length])
    with pytest.raises(InputError, match=r"mmt session recover .*cut\.mcap"):
        read_session(cut)
    described = info(cut)
    saved = recover(cut, folder / "saved.mcap")
    flushed = sum(end <= length for end in ends) * FLUSH_FRAMES
    assert flushed <= saved.frames <= flushed + FLUSH_FRAMES
    assert described.frames == saved.frames
    assert not described.complete
    assert saved.problem
    session = read_session(saved.path)
    assert not session.complete
    np.testing.assert_array_equal(session.frames, frames[: saved.frames])
    assert session.annotations == b"truth"
    assert session.scene == {"session": {"name": "wood"}}
    assert abs(len(session.events) - saved.frames // FLUSH_FRAMES) <= 1
    assert cut.read_bytes() == content[:length]


LONGEST_BLOCK = 64 * 1024
PLACES = st.one_of(st.floats(0, 1), st.floats(0, 0.005), st.floats(0.985, 1))
"""Most of the records beside the chunks are near both ends."""


def kept_frames(path, damage):
    """The frames' places in a file's chunks that a damaged range does not touch."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    kept = []
    for first, chunk in enumerate(summary.chunk_indexes):
        begin, end = chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
        if end <= damage.start or begin >= damage.stop:
            kept += range(first * FLUSH_FRAMES, (first + 1) * FLUSH_FRAMES)
    return set(kept)


@example(place=0.0, damage=b"\x04", flips=True)
@example(place=0.0, damage=bytes(LONGEST_BLOCK), flips=False)
@example(place=1.0, damage=bytes(LONGEST_BLOCK), flips=False)
@example(place=0.001567947491081682, damage=bytes(14), flips=False)  # a checksum and all
@example(place=0.00039884420557422483, damage=b"\x01", flips=False)  # the length of the version
@given(
    place=PLACES,
    damage=st.one_of(
        st.integers(1, 255).map(lambda value: bytes([value])),
        st.tuples(st.integers(2, LONGEST_BLOCK), st.integers(0, 2**32)).map(
            lambda size_seed: np.random.default_rng(size_seed[1]).bytes(size_seed[0])
        ),
        st.integers(2, LONGEST_BLOCK).map(bytes),
    ),
    flips=st.booleans(),
)
@settings(max_examples=40)
def test_damage_costs_what_it_touches_and_is_never_called_whole(
    tmp_path_factory, whole, place, damage, flips
):
    path, frames, _ = whole
    content = bytearray(path.read_bytes())
    start = int(place * (len(content) - 1))
    stop = min(len(content), start + len(damage))
    before = np.frombuffer(content[start:stop], np.uint8)
    change = np.frombuffer(damage[: stop - start], np.uint8)
    content[start:stop] = (before ^ change if flips else change).tobytes()
    folder = tmp_path_factory.mktemp("damaged")
    damaged = folder / "damaged.mcap"
    damaged.write_bytes(content)
    if content == path.read_bytes():
        return
    with pytest.raises(InputError):
        read_session(damaged)
    with pytest.raises(InputError):
        sum(len(block) for block in blocks_of(open_recording(damaged)))
    saved = recover(damaged, folder / "saved.mcap")
    assert saved.problem
    session = read_session(saved.path)
    assert not session.complete
    sequence = session.frames["sequence"].astype(int)
    np.testing.assert_array_equal(session.frames, frames[sequence])
    touched = range(start, stop)
    assert kept_frames(path, touched) <= set(sequence)
    assert saved.missing_frames + len(sequence) <= len(frames)
    with path.open("rb") as stream:
        models = [
            index.offset + index.length <= start or index.offset >= stop
            for index in make_reader(stream).get_summary().attachment_indexes
        ]
    assert len(session.models) + bool(session.annotations) >= sum(models)
    assert {model for _, model in session.models} <= {b"npz"}
    assert session.annotations in {b"", b"truth"}


@pytest.mark.parametrize("value", [0x07, 0x0C, 0x46, 0x80])
def test_a_chunk_that_passes_for_another_record_is_left_out(tmp_path, whole, value):
    path, frames, _ = whole
    content = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        content[make_reader(stream).get_summary().chunk_indexes[4].chunk_start_offset] = value
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content)
    for read in (read_session, lambda file: list(blocks_of(open_recording(file)))):
        with pytest.raises(InputError, match="1 damaged chunks"):
            read(damaged)
    saved = recover(damaged, tmp_path / "saved.mcap")
    assert saved.frames + saved.missing_frames == len(frames)
    assert np.isin(read_session(saved.path).frames, frames).all()


def test_a_damaged_chunk_costs_its_own_frames_only(tmp_path, whole):
    path, frames, _ = whole
    with path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    content = bytearray(path.read_bytes())
    for chunk in (chunks[0], chunks[4]):
        middle = chunk.chunk_start_offset + chunk.chunk_length // 2
        content[middle : middle + 8] = b"\xa5" * 8
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content)
    with pytest.raises(InputError, match="2 damaged chunks"):
        read_session(damaged)
    saved = recover(damaged, tmp_path / "saved.mcap")
    assert (saved.damaged_chunks, saved.chunks) == (2, len(chunks) - 2)
    assert saved.frames == 4000
    assert saved.missing_frames == 500
    kept = np.delete(frames, np.r_[:500, 2000:2500])
    np.testing.assert_array_equal(read_session(saved.path).frames, kept)


def test_a_damaged_scene_does_not_cost_the_frames(tmp_path, whole):
    path, frames, _ = whole
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(path.read_bytes().replace(b'"wood"', b'"wood?', 1))
    with pytest.raises(InputError, match="its checksum does not fit"):
        read_session(damaged)
    saved = recover(damaged, tmp_path / "saved.mcap")
    assert read_session(saved.path).scene is None
    np.testing.assert_array_equal(read_session(saved.path).frames, frames)


def test_a_tail_of_zeros_is_cut_off(tmp_path, whole):
    path, frames, ends = whole
    broken = tmp_path / "zeros.mcap"
    broken.write_bytes(path.read_bytes()[: ends[3]] + bytes(10_000))
    saved = recover(broken, tmp_path / "saved.mcap")
    np.testing.assert_array_equal(read_session(saved.path).frames, frames[:2000])


def test_a_whole_file_is_copied_whole(tmp_path):
    path, out = tmp_path / "run.mcap", tmp_path / "copy.mcap"
    beside = {"scene": {"a": 1}, "annotations": b"truth", "models": [(0.1, b"npz")]}
    outputs = [OutputBlock(0.1, "model", np.ones(3))]
    events = [{"time_s": 0.2, "event": "mark"}]
    write_session(path, made_frames(300), events=events, outputs=outputs, **beside)
    saved = recover(path, out)
    assert (saved.problem, saved.damaged_chunks, saved.frames) == ("", 0, 300)
    before, after = read_session(path), read_session(out)
    assert after.complete
    np.testing.assert_array_equal(after.frames, before.frames)
    for name in (*beside, "events"):
        assert getattr(after, name) == getattr(before, name)
    assert after.outputs[0].mode == "model"


def test_the_file_itself_and_hopeless_files_are_refused(tmp_path, whole):
    path, out = whole[0], tmp_path / "out.mcap"
    hopeless = tmp_path / "hopeless.mcap"
    hopeless.write_bytes(path.read_bytes()[:200])
    for source, target, said in (
        (path, path, "name another file"),
        (tmp_path / "absent.mcap", out, "No such file"),
        (hopeless, out, "nothing in it can be read"),
        (path, tmp_path / "nowhere" / "out.mcap", "cannot write"),
    ):
        with pytest.raises(InputError, match=said):
            recover(source, target)
    assert not out.exists()


WRITER = """
import sys, time, pathlib
sys.path.insert(0, sys.argv[2])
from session_samples import made_frames
from mmt.core.frames import CHANNELS
from mmt.session.recorder import McapRecorder
frames = made_frames(60_000)
recorder = McapRecorder(pathlib.Path(sys.argv[1]), channels=CHANNELS)
start_s = time.monotonic()
sent = 0
while True:
    due = int((time.monotonic() - start_s) * 1000)
    for index in range(sent, due):
        recorder.record_frames(frames[index:index + 1])
    sent = due
    print(sent, recorder.frames, flush=True)
    time.sleep(0.005)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGKILL")
def test_a_killed_recorder_loses_at_most_the_last_flush(tmp_path):
    path = tmp_path / "run.mcap"
    arguments = [sys.executable, "-c", WRITER, str(path), str(Path(__file__).parent)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        try:
            for line in child.stdout:
                sent, flushed = map(int, line.split())
                if sent > 1300 and flushed > 0:
                    break
        finally:  # else leaving the block would wait for it
            child.kill()
    with pytest.raises(InputError, match="mmt session recover"):
        read_session(path)
    saved = recover(path, tmp_path / "saved.mcap")
    # A recorder on a loaded machine may be late with its flush, but never loses one.
    assert saved.frames >= flushed > 0
    assert saved.missing_frames == 0
    expected = made_frames(60_000)[: saved.frames]
    np.testing.assert_array_equal(read_session(saved.path).frames, expected)


def packed(source, target, compression, chunk_size):
    """Write a session anew, as another program would, with scene, chunks and compression."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out, chunk_size, compression)
        writer.start()
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, {**record.metadata, "json": '{"control": {}}'})
        ids = {}
        for schema, channel, message in reader.iter_messages():
            if channel.topic not in ids:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            writer.add_message(
                ids[channel.topic],
                *(message.log_time, message.data, message.publish_time, message.sequence),
            )
        writer.finish()
    return target


@given(compression=st.sampled_from(CompressionType), chunk_size=st.integers(1, 1 << 20))
@example(CompressionType.LZ4, 1 << 14)
@settings(max_examples=6)
def test_a_session_is_read_whatever_it_is_packed_by(
    tmp_path_factory, whole, compression, chunk_size
):
    source, frames, _ = whole
    path = packed(source, tmp_path_factory.mktemp("packed") / "other.mcap", compression, chunk_size)
    session = read_session(path)
    np.testing.assert_array_equal(session.frames, frames)
    stream = open_recording(path)
    assert isinstance(stream, IndexedSession)
    np.testing.assert_array_equal(np.concatenate(list(blocks_of(stream))), frames)
    assert len(stream.events) == len(session.events) == 10
    windows = open_windows(path)
    assert not windows.in_memory
    np.testing.assert_array_equal(windows.window(0.0, 10.0).frames, frames)


@pytest.mark.parametrize("lost", ["offsets", "entry"])
def test_a_chunk_that_the_index_does_not_tell_is_read(tmp_path, whole, monkeypatch, lost):
    path = packed(whole[0], tmp_path / "other.mcap", CompressionType.ZSTD, 1 << 14)
    found = scan.make_reader

    def make(stream):
        summary = (reader := found(stream)).get_summary()
        if lost == "offsets":
            summary.chunk_indexes[3].message_index_offsets.clear()
        else:
            del summary.chunk_indexes[3]
        return reader

    monkeypatch.setattr(scan, "make_reader", make)
    blocks = list(blocks_of(open_recording(path)))
    np.testing.assert_array_equal(np.concatenate(blocks), whole[1])


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_a_chunk_larger_than_it_says_is_damaged(tmp_path, whole, compression):
    path = packed(whole[0], tmp_path / "other.mcap", compression, 1 << 14)
    with path.open("rb") as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[3]
    data = bytearray(path.read_bytes())
    sizes = struct.pack("<QQ", chunk.compressed_size, chunk.uncompressed_size)
    for at in (chunk.chunk_start_offset + 25, data.index(sizes) + 8):  # in the chunk, in its index
        assert data[at : at + 8] == sizes[8:]
        data[at : at + 8] = struct.pack("<Q", chunk.uncompressed_size - 1)
    path.write_bytes(data)
    with pytest.raises(InputError, match="mmt session recover"):
        read_session(path)
    with pytest.raises(InputError, match="mmt session recover"):
        list(blocks_of(open_recording(path)))
    windows = open_windows(path)
    assert 0 < len(windows.window(0.0, 10.0).frames) < len(whole[1])


def test_a_small_file_that_unpacks_to_much_is_refused_before_it_does(tmp_path, monkeypatch):
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 30, compression=CompressionType.ZSTD)
        writer.start()
        schema = writer.register_schema("a", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for number in range(70):
            writer.add_message(channel, number, bytes(1 << 20), number)
        writer.finish()
    assert path.stat().st_size < 1 << 20
    tracemalloc.start()
    try:
        for read in (read_session, open_recording):
            with pytest.raises(InputError, match=r"more than the 64 MiB .*MMT_MOST_MIB allows mo"):
                read(path)
        with pytest.raises(InputError, match="without the topic"):  # of what may be read
            open_windows(path)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
    monkeypatch.setenv("MMT_MOST_MIB", "100")
    with pytest.raises(InputError, match="without the topic"):
        read_session(path)
    monkeypatch.setenv("MMT_MOST_MIB", "a lot")
    for read in (read_session, open_recording, open_windows):
        with pytest.raises(InputError, match="MMT_MOST_MIB is 'a lot' in the environment"):
            read(path)
