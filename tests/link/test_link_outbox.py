import asyncio
import gc

import pytest
from link_samples import until

from mmt.link.protocol import encode_event
from mmt.link.queue import SendQueue


class Link:
    """Takes messages one at a time, when it is let."""

    def __init__(self, permits=10**6):
        self.sent = []
        self.permits = asyncio.Semaphore(permits)
        self.broken = False

    async def __call__(self, message):
        await self.permits.acquire()
        if self.broken:
            raise ConnectionResetError
        self.sent.append(message)


async def spin():
    for _ in range(20):
        await asyncio.sleep(0)


async def test_messages_go_out_in_their_order():
    outbox, link = SendQueue(100), Link()
    outbox.open(link)
    for number in range(50):
        outbox.put(2, bytes([number]))
        if number % 7 == 0:
            await asyncio.sleep(0)
    async with asyncio.timeout(5.0):
        await outbox.finish(60.0)
    assert link.sent == [bytes([number]) for number in range(50)]
    assert (outbox.messages, outbox.records, outbox.bytes, outbox.dropped) == (50, 100, 50, 0)
    assert not outbox.is_open


async def test_everything_put_is_either_sent_or_dropped():
    outbox, link = SendQueue(4), Link(permits=6)
    outbox.put(1, b"too early")
    outbox.open(link)
    for _ in range(20):
        outbox.put(1, b"x")
        await spin()
    outbox.close()
    await spin()
    outbox.put(1, b"too late")
    assert outbox.records + outbox.dropped == 22
    assert len(link.sent) == outbox.messages == 6


@pytest.mark.parametrize("waits", [False, True])
async def test_a_broken_link_ends_the_sending(waits):
    outbox, link = SendQueue(4), Link(permits=0 if waits else 10)
    outbox.open(link)
    if waits:
        outbox.put(1, b"x")
    link.broken = True
    outbox.put(1, b"x")
    link.permits.release()
    await until(lambda: not outbox.is_open)
    outbox.put(1, b"y")
    mended = Link()
    outbox.open(mended)
    assert (outbox.records, outbox.dropped) == (0, 2 + waits)
    outbox.put(1, b"z")
    await outbox.finish(1.0)
    assert mended.sent == [b"z"]


async def test_a_flush_waits_for_what_is_queued_but_not_for_ever():
    outbox, link = SendQueue(4), Link(permits=0)
    assert not outbox.idle
    outbox.open(link)
    assert outbox.idle
    outbox.put(1, b"x")
    outbox.put(1, b"y")
    await outbox.flush(0.01)
    assert (link.sent, outbox.idle) == ([], False)
    async with asyncio.timeout(5.0):
        flushing = asyncio.create_task(outbox.flush(60.0))
        for sent in ([], [b"x"], [b"x", b"y"]):
            await spin()
            assert (link.sent, flushing.done()) == (sent, False)
            link.permits.release()
        await flushing
        assert outbox.idle
        outbox.close()
        await outbox.flush(60.0)


async def test_records_go_out_a_hundred_at_most_in_a_message():
    outbox, link = SendQueue(1), Link()
    outbox.open(link)
    data = bytes(range(250)) * 3
    outbox.put_records("frames", b"", 3)
    assert link.sent == []
    outbox.put_records("frames", data, 3)
    parts = data[:300], data[300:600], data[600:]
    assert link.sent == [encode_event("frames", part) for part in parts]
    assert outbox.records == 250
    outbox.close()


async def test_a_fault_that_is_not_the_links_comes_to_light():
    outbox, told = SendQueue(4), []
    asyncio.get_running_loop().set_exception_handler(lambda _, said: told.append(said["exception"]))

    async def fail(message):
        raise ZeroDivisionError

    outbox.open(fail)
    outbox.put(1, b"x")
    await spin()
    assert not outbox.is_open
    outbox.close()
    gc.collect()
    assert [type(each) for each in told] == [ZeroDivisionError]


async def test_what_the_link_takes_at_once_is_sent_as_it_is_put():
    outbox, link = SendQueue(1), Link(permits=3)
    outbox.open(link)
    for number in range(5):
        outbox.put(1, bytes([number]))
    assert link.sent == [b"\0", b"\1", b"\2"]
    assert (outbox.messages, outbox.dropped) == (3, 0)  # one is under way, one waits
    link.permits.release()
    link.permits.release()
    await until(lambda: outbox.messages == 5)
    link.permits.release()
    outbox.put(1, b"\5")  # at once again
    assert link.sent == [bytes([number]) for number in range(6)]
    outbox.close()


async def test_a_full_queue_gives_up_the_oldest_but_not_the_message_under_way():
    outbox, link = SendQueue(2), Link(permits=0)
    outbox.open(link)
    for number in range(6):
        outbox.put(5, bytes([number]))
    assert outbox.dropped == 3 * 5
    for _ in range(3):
        link.permits.release()
    await until(lambda: outbox.messages == 3)
    assert link.sent == [b"\0", b"\4", b"\5"]
    outbox.put(3, b"x")
    outbox.put(3, b"y")
    for _ in range(2):  # which does not wait for ever
        await outbox.finish(0.01)
        await spin()
    assert outbox.dropped == 3 * 5 + 6


async def test_closing_gives_up_the_message_under_way():
    given_up = []

    async def never(message):
        try:
            await asyncio.get_running_loop().create_future()
        except BaseException as error:
            given_up.append(type(error))
            raise

    for turns in (0, 20):
        outbox = SendQueue(4)
        outbox.open(never)
        outbox.put(2, b"x")
        outbox.put(2, b"y")
        for _ in range(turns):
            await asyncio.sleep(0)
        outbox.close()
        await spin()
        assert outbox.dropped == 4
    assert given_up == [GeneratorExit, asyncio.CancelledError]


async def test_a_link_may_wait_several_times_and_handle_what_it_waits_for():
    sent = []
    future = asyncio.get_running_loop().create_future()

    async def send(message):
        try:
            await future
        except KeyError:
            await asyncio.sleep(0.001)
            await asyncio.sleep(0)
        sent.append(message)

    outbox = SendQueue(4)
    outbox.open(send)
    outbox.put(1, b"x")
    outbox.put(1, b"y")
    await spin()
    assert sent == []
    future.set_exception(KeyError())
    await outbox.finish(5.0)
    assert sent == [b"x", b"y"]
    assert outbox.dropped == 0
