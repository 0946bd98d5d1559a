"""Frames that did not arrive are kept, asked for, and sent again behind the live ones."""

import asyncio
from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_samples import (
    CHANNELS,
    FollowerNotes,
    LeaderNotes,
    follower,
    frames,
    hello,
    leader,
    until,
)

from mmt.core.frames import frame_dtype
from mmt.core.sequence_numbers import SEQUENCES
from mmt.link.frame_sender import FRAMES_PER_MESSAGE, BackfillSender, FrameBuffer, FrameSender
from mmt.link.protocol import BACKFILL, FRAMES, GONE, MAX_RANGES, encode_event
from mmt.link.queue import SendQueue

DTYPE = frame_dtype(CHANNELS)


@given(
    st.integers(1, 40),
    st.lists(st.tuples(st.integers(1, 30), st.integers(0, 5)), max_size=12),
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 40)), max_size=4),
)
def test_the_newest_frames_are_kept(capacity, blocks, asked):
    kept = FrameBuffer(DTYPE, capacity)
    sent = []
    firsts = accumulate((count + skipped for count, skipped in blocks), initial=0)
    for (count, _), first in zip(blocks, firsts, strict=False):
        kept.put(frames(first, count).tobytes())
        sent += range(first, first + count)
    newest = set(sent[-capacity:])
    assert len(kept) == len(newest)
    ranges = [(first, first + count) for first, count in asked]
    found = kept.select(ranges)
    wanted = {number for first, stop in ranges for number in range(first, stop)}
    assert found["sequence"].tolist() == sorted(newest & wanted)
    for frame in found:
        assert frame == frames(int(frame["sequence"]))[0]


@given(st.integers(1, 12), st.integers(0, 30))
def test_what_is_kept_across_a_wrap_is_found_in_order(capacity, count):
    kept = FrameBuffer(DTYPE, capacity)
    sent = [number % SEQUENCES for number in range(SEQUENCES - 9, SEQUENCES - 9 + count)]
    for number in sent:
        kept.put(frames(number).tobytes())
    newest = sorted(sent[-capacity:])
    asked = [(3, 9), (0, 4), (SEQUENCES - 4, SEQUENCES), (SEQUENCES - 9, SEQUENCES - 8)]
    wanted = {number for first, stop in asked for number in range(first, stop)}
    assert kept.select(asked)["sequence"].tolist() == [each for each in newest if each in wanted]
    assert kept.select([(0, SEQUENCES)])["sequence"].tolist() == newest
    assert kept.select([])["sequence"].tolist() == []


class Sent:
    """A link that takes messages when it is let, and says what they were."""

    def __init__(self):
        self.messages = []
        self.takes = asyncio.Event()
        self.takes.set()

    async def __call__(self, message):
        await self.takes.wait()
        self.messages.append(message)


class Backfilling:
    """What sends frames 0 to 999 again, over a link that takes nothing until it is let."""

    def __init__(self):
        self.kept, self.outbox, self.link = FrameBuffer(DTYPE, 1000), SendQueue(50), Sent()
        self.kept.put(frames(0, 1000).tobytes())
        self.sender = BackfillSender(self.kept, self.outbox)
        self.outbox.open(self.link)
        self.sender.open()
        self.link.takes.clear()
        self.outbox.put(1, b"live")


@pytest.mark.parametrize("keep_frames", [0, 10])
async def test_frames_go_out_as_many_at_once_as_the_hello_says(keep_frames):
    outbox, link = SendQueue(50), Sent()
    outbox.open(link)
    sender = FrameSender(hello(frames_per_message=3, keep_frames=keep_frames), outbox)
    assert (sender.sent, sender.backfiller is None) == (0, not keep_frames)
    with pytest.raises(ValueError, match="the hello's are of"):
        sender.put(np.zeros(1))
    for first in range(5):
        sender.put(frames(first))
        sender.put(frames(0, 0))  # of which nothing is sent
    await outbox.flush(10.0)
    assert link.messages == [encode_event(FRAMES, frames(0, 3).tobytes())]
    assert sender.sent == 3
    for _ in range(2):  # the second has nothing to send
        sender.flush()
    await outbox.flush(10.0)
    assert link.messages[1:] == [encode_event(FRAMES, frames(3, 2).tobytes())]
    assert sender.sent == 5
    counts = {"kept": 5, "asked": 0, "sent": 0, "gone": 0}
    assert sender.backfill == (counts if keep_frames else {})


async def test_back_fill_goes_out_in_pieces_and_lets_live_frames_pass():
    made = Backfilling()
    outbox, backfiller = made.outbox, made.sender
    backfiller.request([[100, 150], [990, 1010]])
    await asyncio.sleep(0.03)
    gone = encode_event(GONE, [(1000, 1010)])
    made.link.takes.set()
    await until(lambda: backfiller.sent == 60)
    await outbox.flush(1.0)
    expected = [b"live", gone]
    numbers = [*range(100, 150), *range(990, 1000)]
    for start in range(0, 60, FRAMES_PER_MESSAGE):
        block = made.kept.select([(n, n + 1) for n in numbers[start : start + FRAMES_PER_MESSAGE]])
        expected.append(encode_event(BACKFILL, block.tobytes()))
    assert made.link.messages == expected
    assert (backfiller.asked, backfiller.gone) == (70, 10)
    assert outbox.records == 1
    backfiller.close()
    outbox.close()


async def test_what_is_promised_is_not_sent_twice_and_a_flood_of_requests_is_refused():
    made = Backfilling()
    backfiller = made.sender
    for _ in range(20):
        backfiller.request([[0, 100]])
        await asyncio.sleep(0.001)
    made.kept.put(frames(1000, 1000).tobytes())
    backfiller.request([[1000, 2000]])
    await until(lambda: backfiller.gone == 100)  # no more wait than are buffered
    made.link.takes.set()
    await backfiller.finish(5.0)
    assert backfiller.sent == 1000
    backfiller.request("nonsense")
    for first in range(0, 4 * MAX_RANGES, 2):
        backfiller.request([[first, first + 1]])
    assert backfiller.rejected == 1 + 2 * MAX_RANGES - (MAX_RANGES + 1)
    backfiller.close()
    backfiller.request([[0, 100]])
    await asyncio.wait_for(backfiller.finish(30.0), 5.0)  # nothing is sent any more
    made.outbox.close()


async def test_the_leader_asks_while_frames_stream_and_at_the_end_for_all_that_is_missing():
    notes, filled, gone, settled = LeaderNotes(), [], [], []

    def settle(sent):
        settled.append(sent)
        return [[(62, 65), (98, 101)], [(98, 99)], []][len(settled) - 1]  # one is lost again

    events = replace(
        notes.events(), on_backfill=filled.append, on_gone=gone.append, on_settle=settle
    )
    async with (
        leader(events=events) as server,
        follower(server.port, FollowerNotes(), keep_frames=50) as client,
    ):
        await until(lambda: server.can_send)
        client.send_frames(frames(0, 100))
        server.request_frames([(0, 3), (60, 80)])
        await until(lambda: filled and gone)
        assert gone == [[(0, 3)]]
        np.testing.assert_array_equal(np.concatenate(filled), frames(60, 20))
        assert notes.sequences == list(range(100))
        filled.clear()
        await client.end("done")
        assert client.frames.backfill == {"kept": 50, "asked": 30, "sent": 26, "gone": 4}
    assert settled == [100, 100, 100]
    assert np.sort(np.concatenate(filled)["sequence"]).tolist() == [62, 63, 64, 98, 98, 99]
    assert gone[1:] == [[(100, 101)]]
    assert notes.ends == ["done"]
