from itertools import pairwise

import numpy as np
import pytest
from frame_samples import made_frames

import mmt
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.evaluation.evaluate import evaluate_session
from mmt.session.data import RecordedSession
from mmt.session.files import read_session, write_session
from mmt.session.mcap.index import IndexedSession
from mmt.session.recorder import McapRecorder
from mmt.session.stream import blocks_of, in_memory, open_recording
from mmt.texture.online.history import stream_blocks
from mmt.texture.signals.filtering import StreamNumbering


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A session of 15 s in many chunks, with its scene and its truth."""
    path = tmp_path_factory.mktemp("stream") / "wood.mcap"
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=15.0)
    write_session(path, frames, scene=mmt.Scene().dump(), annotations=truth)
    return path


def test_a_stream_has_the_frames_of_the_file_in_their_order(file):
    stream, session = open_recording(file), read_session(file)
    assert isinstance(stream, IndexedSession)
    for _ in range(2):  # every reading begins anew
        blocks = list(blocks_of(stream))
        assert len(blocks) > 1
        np.testing.assert_array_equal(np.concatenate(blocks), session.frames)
    assert (stream.scene, stream.annotations) == (session.scene, session.annotations)
    np.testing.assert_array_equal(in_memory(stream).frames, session.frames)


def test_an_evaluation_of_a_stream_is_that_of_the_session_to_the_digit(file):
    streamed = evaluate_session(open_recording(file)).as_dict()
    whole = evaluate_session(read_session(file)).as_dict()
    for figures in (streamed, whole):
        for name in [name for name in figures if "processing" in name or "real_time" in name]:
            del figures[name]
        moments = [figures[name] for name in ("at_start", "at_stop", "at_end")]
        for step in [*figures["steps"], *moments]:
            del step["update_ms"]
    assert streamed == whole


def test_what_is_not_in_order_or_no_whole_mcap_is_read_into_memory(file, tmp_path):
    frames = made_frames(0, 3000)
    write_session(tmp_path / "made.npz", frames)
    assert isinstance(open_recording(tmp_path / "made.npz"), RecordedSession)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match="mmt session recover"):
        open_recording(cut)
    with pytest.raises(InputError, match="nowhere"):
        open_recording(tmp_path / "nowhere.mcap")
    late = tmp_path / "late.mcap"
    with McapRecorder(late, channels=CHANNELS) as recorder:
        recorder.record_frames(frames[:30])
        recorder.record_frames(frames[70:100])
        recorder.record_backfill(frames[30:70], 0)
    session = open_recording(late)
    assert isinstance(session, RecordedSession)
    np.testing.assert_array_equal(session.frames, frames[:100])


def test_a_damaged_chunk_is_said_where_it_is_met(file, tmp_path):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged\.mcap: .*mmt session recover"):
        list(blocks_of(open_recording(damaged)))


@pytest.mark.parametrize("parts", [[5, 400, 1, 2594], [1] * 50 + [2950], [3000], [1500, 0, 1500]])
@pytest.mark.parametrize("order", ["even", "gap", "again"])
def test_blocks_do_not_depend_on_the_parts_that_a_session_comes_in(parts, order):
    frames = made_frames(0, 3000)
    if order == "gap":
        frames["sequence"][1200:] += 700
    if order == "again":  # the follower began anew
        frames["sequence"][2000:] = np.arange(1000)
    edges = np.cumsum([0, *parts])
    cut = [frames[start:stop] for start, stop in pairwise(edges.tolist())]
    expected = whole_blocks(StreamNumbering().number(frames), 250)
    assert [len(block) for block in stream_blocks(cut, 250)] == expected
    assert [len(block) for block in stream_blocks([frames], 250)] == expected


def whole_blocks(frames, period):
    """Lengths of the blocks by the definition: full where the newest number is a period on."""
    numbers = frames["sequence"].astype(int).tolist()
    lengths, start, newest = [], 0, -1
    for index, number in enumerate(numbers):
        newest = max(newest, number)
        if newest >= numbers[start] + period - 1:
            lengths.append(index + 1 - start)
            start = index + 1
    return [*lengths, len(numbers) - start] if start < len(numbers) else lengths
