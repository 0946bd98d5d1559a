"""Who is turned away, what is thrown away, and what each is told."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import pytest
import socketio
from hypothesis import HealthCheck, given, settings
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

from mmt.core.errors import InputError, MmtError
from mmt.link.client import FollowerClient
from mmt.link.protocol import FollowerHello, reason_of
from mmt.link.server import LeaderServer
from mmt.scene import Link

GOOD = hello().to_auth()
SEVERAL = {**GOOD, "protocol": 2, "samples_per_frame": 5}


@pytest.fixture
async def server() -> AsyncIterator[LeaderServer]:
    async with leader() as started:
        yield started


def without(key: str) -> dict[str, object]:
    return {name: value for name, value in GOOD.items() if name != key}


@pytest.mark.parametrize(
    ("auth", "sentence"),
    [
        (None, "hello is missing"),
        ([], "hello is missing"),
        ("follower", "hello is missing"),
        (without("protocol"), "lacks 'protocol'"),
        ({**GOOD, "protocol": 3}, "link protocol 3, the leader 1 and 2: install the same version"),
        ({**GOOD, "protocol": 2}, "lacks 'samples_per_frame'"),
        ({**SEVERAL, "samples_per_frame": 0}, "samples_per_frame is 0: allowed is 1 to 10"),
        ({**SEVERAL, "samples_per_frame": 11}, "samples_per_frame is 11"),
        ({**SEVERAL, "samples_per_frame": 5.0}, "'samples_per_frame' is a float"),
        ({**GOOD, "protocol": "1"}, "'protocol' is a str: allowed is int"),
        ({**GOOD, "protocol": True}, "'protocol' is a bool: allowed is int"),
        ({**GOOD, "rate_hz": 500}, "streams at 500 Hz, the leader's scene expects 1000 Hz"),
        ({**GOOD, "rate_hz": 1000.0}, "'rate_hz' is a float"),
        ({**GOOD, "channels": "position"}, "'channels' is a str: allowed is list"),
        ({**GOOD, "channels": []}, "channels: none given"),
        ({**GOOD, "channels": ["smell", 3]}, "channels: 3, smell given, allowed are position"),
        (
            {**GOOD, "channels": ["position", "force", "acceleration"]},
            "sends position, force, acceleration, the leader's scene needs position, force",
        ),
        (
            {**GOOD, "channels": ["position"]},
            "sends position, the leader's scene needs position, f",
        ),
        ({**GOOD, "frames_per_message": 0}, "frames_per_message is 0: allowed is 1 to 100"),
        ({**GOOD, "frames_per_message": 101}, "frames_per_message is 101"),
        ({**GOOD, "annotations": "text"}, "'annotations' is a str: allowed is bytes"),
        ({**GOOD, "annotations": bytes(65_537)}, "annotations are 65537 bytes: at most 65536"),
        ({**GOOD, "clock_id": None}, "'clock_id' is a NoneType"),
        ({**GOOD, "source": "x" * 257}, "source is longer than the 256"),
    ],
)
async def test_a_bad_hello_is_refused_with_a_sentence(
    server: LeaderServer, auth: Any, sentence: str
) -> None:
    reasons: list[Any] = []
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    client.on("connect_error", reasons.append)
    with pytest.raises(socketio.exceptions.ConnectionError):
        await client.connect(
            f"http://127.0.0.1:{server.port}", auth=auth, transports=["websocket"], wait_timeout=5
        )
    assert sentence in reasons[0]["message"]
    assert not server.connected
    async with follower(server.port):  # the place is free
        assert server.connected


async def test_the_followers_user_reads_the_refusal(server: LeaderServer) -> None:
    with pytest.raises(MmtError, match=r"the leader at http://127.+ refused: .+ needs position, f"):
        async with follower(server.port, channels=("position",)):
            pass


async def test_a_second_follower_is_refused_until_the_first_has_gone(server: LeaderServer) -> None:
    async with follower(server.port) as first:
        with pytest.raises(MmtError, match="another follower is connected"):
            async with follower(server.port):
                pass
        assert first.connected
        assert server.connected
    await until(lambda: not server.connected)
    async with follower(server.port) as second:
        assert second.connected


async def test_the_leader_itself_may_refuse() -> None:
    notes = LeaderNotes()

    def refuse(_: FollowerHello) -> None:
        raise MmtError("the session is over")

    async with leader(events=replace(notes.events(), on_follower=refuse)) as server:
        with pytest.raises(MmtError, match="refused: the session is over"):
            async with follower(server.port):
                pass
    assert notes.errors == notes.losses == []


async def test_malformed_events_do_no_harm() -> None:
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        for data in ("text", 5, None, {"a": b"b"}, b"", bytes(37), frames(0, 101).tobytes()):
            await client.emit("frames", data)
        await client.emit("frames", (frames(0).tobytes(), frames(1).tobytes()))
        for data in (
            None,
            3,
            {"reason": 5, "frames": 1},
            {"reason": "x"},
            {"reason": "x", "frames": "y"},
        ):
            await client.emit("end", data)
        for data in (None, 3, b"x", {"event": "x"}):
            await client.emit("event", data)
        await client.emit("unknown event", b"x")
        broken = frames(0)
        broken["force_n"] = float("nan")
        await client.emit("frames", broken.tobytes())
        await client.emit("frames", frames(1).tobytes())
        await until(lambda: notes.sequences == [1])
        assert server.statistics.rejected == {
            "not bytes": 5,
            "size": 2,
            "too many": 1,
            "malformed end": 5,
            "malformed event": 4,
            "not finite": 1,
        }
        assert server.connected
        await client.disconnect()
    assert notes.ends == []
    assert notes.errors == []


async def test_packets_that_are_no_socketio_do_no_harm(caplog: pytest.LogCaptureFixture) -> None:
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        with caplog.at_level(logging.ERROR):
            for data in [b"\xc1", b"\x80", b"\x93\x01\x02\x03", "text", b"\x00" * 100] * 20:
                await client.eio.send(data)
            await client.emit("frames", frames(0).tobytes())
            await until(lambda: notes.sequences == [0])
        assert len(caplog.records) < 20  # a bad peer cannot fill the disk
        await client.disconnect()


async def test_a_message_that_is_too_long_closes_that_link_alone() -> None:
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False, reconnection=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        await client.emit("frames", bytes(200_000))
        await until(lambda: notes.losses)
        await until(lambda: not client.connected)
        async with follower(server.port) as other:
            other.send_frames(frames(0))
            await until(lambda: notes.sequences == [0])


async def test_events_after_the_end_are_not_of_the_session() -> None:
    notes = LeaderNotes()
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    async with leader(notes) as server:
        await client.connect(f"http://127.0.0.1:{server.port}", auth=GOOD, transports=["websocket"])
        await client.emit("frames", frames(0).tobytes())
        await client.call("end", {"reason": "x" * 1000, "frames": 1})
        await client.emit("frames", frames(1).tobytes())
        await client.call("end", {"reason": "again", "frames": 2})
        await client.disconnect()
    assert notes.sequences == [0]
    assert notes.ends == ["x" * 256]


async def test_no_leader_is_explained(unused_tcp_port: int) -> None:
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    with pytest.raises(
        MmtError, match=r"no leader answered at .+ within 0\.3 s .*start mmt-leader"
    ):
        await client.connect(0.3)
    await client.disconnect()


async def test_a_server_that_is_no_leader_is_explained() -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
        await writer.drain()
        writer.close()
        await writer.wait_closed()

    other = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = other.sockets[0].getsockname()[1]
    client = FollowerClient(f"http://127.0.0.1:{port}", hello(), FollowerNotes().events())
    with pytest.raises(MmtError, match="404"):
        await client.connect(0.3)
    other.close()
    await other.wait_closed()


async def test_a_server_that_never_speaks_does_not_hold_the_follower_up() -> None:
    hang = asyncio.Event()

    async def keep_silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await hang.wait()
        writer.close()

    other = await asyncio.start_server(keep_silent, "127.0.0.1", 0)
    port = other.sockets[0].getsockname()[1]
    client = FollowerClient(f"http://127.0.0.1:{port}", hello(), FollowerNotes().events())
    with pytest.raises(MmtError, match="no leader answered"):
        await asyncio.wait_for(client.connect(0.3), 10.0)
    hang.set()
    other.close()
    await asyncio.sleep(0.05)


async def test_the_leader_may_start_after_the_follower(unused_tcp_port: int) -> None:
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    connecting = asyncio.create_task(client.connect(20.0))
    await asyncio.sleep(0.3)
    assert not connecting.done()
    async with leader(port=unused_tcp_port) as server:
        await connecting
        assert server.connected
        await client.disconnect()


async def test_a_follower_may_give_up_while_it_connects(unused_tcp_port: int) -> None:
    client = FollowerClient(
        f"http://127.0.0.1:{unused_tcp_port}", hello(), FollowerNotes().events()
    )
    connecting = asyncio.create_task(client.connect(60.0))
    await asyncio.sleep(0.1)
    connecting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await connecting
    await client.end("nothing")
    await client.disconnect()


@pytest.mark.parametrize(
    "url",
    [
        "",
        "leader",
        "leader:8765",
        "ftp://leader",
        "http://",
        "http://:80",
        "http://h:99999",
        "http://[::1",
    ],
)
def test_a_bad_url_is_explained(url: str) -> None:
    with pytest.raises(InputError, match="allowed is http://HOST:PORT"):
        FollowerClient(url, hello(), FollowerNotes().events())


def test_a_leader_needs_channels() -> None:
    with pytest.raises(InputError, match="channels"):
        LeaderServer(Link(), (), LeaderNotes().events())


JSONISH = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)


@given(st.one_of(JSONISH, st.fixed_dictionaries(dict.fromkeys(GOOD, JSONISH))), JSONISH)
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_no_hello_whatever_breaks_the_leader(auth: object, one: object) -> None:
    variants = [auth] + [{**GOOD, key: one} for key in GOOD]
    for variant in variants:
        with contextlib.suppress(InputError):  # anything else is a fault
            read = FollowerHello.from_auth(variant)
            assert set(read.channels) <= {"position", "force", "acceleration"}
            assert FollowerHello.from_auth(read.to_auth()) == read
    reason = reason_of(auth)
    assert reason is None or len(reason) <= 256


def test_the_hello_puts_channels_in_the_frames_order() -> None:
    assert hello(channels=("force", "position")).channels == CHANNELS
    with pytest.raises(InputError, match="frames_per_message"):
        hello(frames_per_message=0)
