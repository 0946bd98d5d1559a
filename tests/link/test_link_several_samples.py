"""Frames with several samples of acceleration: what is sent is what arrives."""

import msgpack
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from link_samples import drawn_frames, hello

from mmt.core.frames import ALL_CHANNELS, CHANNELS, LARGEST_QUANTITY, MOST_SAMPLES
from mmt.core.sequence_numbers import SEQUENCES
from mmt.link.frame_sender import FrameBuffer, FrameSender
from mmt.link.incoming import BlockReader
from mmt.link.protocol import MAX_MESSAGE_BYTES, MAX_RECORDS_PER_MESSAGE, FollowerHello
from mmt.link.queue import SendQueue

SOME_CHANNELS = st.sets(st.sampled_from(ALL_CHANNELS), min_size=1).map(tuple)
SAMPLES = st.integers(1, MOST_SAMPLES)


def spoil(frames, frame, sample, axis, value):
    frames["acceleration_m_s2"][frame].reshape(-1, 3)[sample, axis] = value


def outbox_into(messages):
    """A follower's queue whose messages are kept."""
    outbox = SendQueue(50)
    outbox.put = lambda records, message: messages.append(message)
    return outbox


@given(
    SOME_CHANNELS,
    SAMPLES,
    st.integers(1, MAX_RECORDS_PER_MESSAGE),
    st.lists(st.integers(1, 130), min_size=1, max_size=5),
    st.integers(0, 2**31),
)
def test_what_a_follower_sends_is_what_a_leader_reads(channels, samples, gathered, counts, seed):
    said = hello(channels=channels, samples_per_frame=samples, frames_per_message=gathered)
    heard = FollowerHello.from_auth(msgpack.unpackb(msgpack.packb(said.to_auth())))
    assert heard == said
    messages = []
    sender = FrameSender(said, outbox_into(messages))
    reader = BlockReader(heard.frame_dtype, "frames")
    kept = FrameBuffer(heard.frame_dtype, sum(counts))
    sent = []
    for count in counts:
        frames = drawn_frames(sum(map(len, sent)), count, said.frame_dtype, seed)
        sent.append(frames)
        sender.put(frames)
        kept.put(frames.tobytes())
    sender.flush()
    assert max(map(len, messages)) <= MAX_MESSAGE_BYTES
    read = [reader.read((msgpack.unpackb(each)["data"][1],), 10**12) for each in messages]
    whole = np.concatenate(sent)
    assert np.array_equal(np.concatenate([block for block in read if block is not None]), whole)
    assert reader.rejected == {}
    assert np.array_equal(kept.select([(0, SEQUENCES)]), whole)


@given(SAMPLES, st.data(), st.sampled_from([np.nan, np.inf, -np.inf, 1.01 * LARGEST_QUANTITY]))
def test_one_bad_sample_rejects_its_frame_alone(samples, data, bad):
    said = hello(channels=CHANNELS, samples_per_frame=samples)
    frames = drawn_frames(0, 5, said.frame_dtype)
    row = data.draw(st.integers(0, 5 * samples - 1))
    spoil(frames, row // samples, row % samples, data.draw(st.integers(0, 2)), bad)
    reader = BlockReader(said.frame_dtype, "frames")
    read = reader.read((frames.tobytes(),), 0)
    assert read is not None
    assert np.array_equal(read, np.delete(frames, row // samples))
    assert sum(reader.rejected.values()) == 1
    other = BlockReader(hello(channels=CHANNELS, samples_per_frame=11 - samples).frame_dtype, "f")
    assert other.read((frames[:1].tobytes(),), 0) is None
    assert other.rejected == {"size": 1}
