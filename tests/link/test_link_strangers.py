"""Strangers take neither the port's room nor the leader's log; who floods is cut off."""

import asyncio
import contextlib
import errno
import logging
import socket
import threading
import time
from contextlib import asynccontextmanager

import aiohttp
import pytest
import trustme
from aiohttp import web
from hypothesis import given, settings
from hypothesis import strategies as st
from link_samples import (
    UPGRADE,
    WEBSOCKET,
    FollowerNotes,
    LeaderNotes,
    follower,
    frames,
    leader,
    stock_client,
    until,
)

import mmt.link.incoming
import mmt.link.serving.accepting
import mmt.link.serving.sockets
from mmt.core.errors import MmtError
from mmt.link.access import Access
from mmt.link.protocol import MAX_ANNOTATIONS_BYTES, encode_event
from mmt.link.serving.gate import BYTES as GATE_BYTES
from mmt.link.serving.gate import Gate
from mmt_lab.bench import strangers as disturbing

TOKEN = "a token that nobody guesses"


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """There is a token, and nobody is closed for its time where a test does not shorten it."""
    monkeypatch.setenv("MMT_LINK_TOKEN", TOKEN)
    monkeypatch.setattr(mmt.link.serving.accepting, "HANDSHAKE_S", 30.0)
    monkeypatch.setattr(mmt.link.serving.sockets, "HANDSHAKE_S", 30.0)


@asynccontextmanager
async def strangers(port, count, says=b"", address="127.0.0.1"):
    """Connections that say this and then nothing."""
    streams = [
        await asyncio.open_connection("127.0.0.1", port, local_addr=(address, 0))
        for _ in range(count)
    ]
    for _, writer in streams:
        writer.write(says)
    try:
        yield streams
    finally:
        for _, writer in streams:
            writer.transport.abort()


async def is_open(stream):
    """Whether the leader has not closed a connection."""
    try:
        async with asyncio.timeout(0.05):
            return await stream[0].read(1) != b""
    except ConnectionError:
        return False
    except TimeoutError:
        return True


async def connects_within(port, timeout_s, **access):
    started_s, known = time.monotonic(), Access(TOKEN, **access)
    url = f"{'https' if access else 'http'}://127.0.0.1:{port}"
    async with follower(url, access=known, timeout_s=timeout_s, run_id="the follower's"):
        assert time.monotonic() - started_s < timeout_s


@pytest.mark.parametrize("says", [b"", WEBSOCKET, UPGRADE], ids=["nothing", "half", "no hello"])
@pytest.mark.parametrize("count", [24, 150])
async def test_connections_that_stay_idle_do_not_keep_the_follower_out(says, count):
    async with leader() as server, strangers(server.port, count, says):
        await connects_within(server.port, 5.0)


async def test_idle_connections_before_tls_do_not_keep_the_follower_out(tmp_path):
    authority = trustme.CA()
    issued = authority.issue_cert("127.0.0.1")
    authority.cert_pem.write_to_path(tmp_path / "authority.pem")
    issued.private_key_pem.write_to_path(tmp_path / "key.pem")
    issued.cert_chain_pems[0].write_to_path(tmp_path / "leader.pem")
    files = {"certificate": tmp_path / "leader.pem", "key": tmp_path / "key.pem"}
    async with leader(**files) as server, strangers(server.port, 60) as idle:
        await connects_within(server.port, 5.0, authority=tmp_path / "authority.pem")
        assert not await is_open(idle[0])


@pytest.mark.parametrize("says", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "])
async def test_headers_that_do_not_end_are_closed(monkeypatch, says):
    monkeypatch.setattr(mmt.link.serving.accepting, "HANDSHAKE_S", 0.3)
    async with leader() as server, strangers(server.port, 1, says) as (one,):
        assert await is_open(one)
        async with asyncio.timeout(5):
            while await is_open(one):
                pass


@pytest.mark.parametrize("descriptors", [None, 40])
async def test_strangers_of_one_address_displace_only_each_other(monkeypatch, descriptors):
    most = mmt.link.serving.accepting.MOST_OF_ADDRESS
    if descriptors is not None:  # few allow few strangers
        monkeypatch.setattr(mmt.link.serving.accepting, "descriptors", lambda: descriptors)
        most = 9
    async with (
        leader() as server,
        strangers(server.port, 1, address="127.0.0.2") as (quiet,),
        strangers(server.port, 200) as many,
    ):
        await asyncio.sleep(0.2)
        still_open = [await is_open(stream) for stream in many]
        assert sum(still_open) == most
        assert still_open == sorted(still_open)  # the oldest went first
        assert await is_open(quiet)


async def test_strangers_of_many_addresses_displace_those_of_the_busiest(monkeypatch):
    monkeypatch.setattr(mmt.link.serving.accepting, "MOST_STRANGERS", 8)
    async with (
        leader() as server,
        strangers(server.port, 2, address="127.0.0.2") as few,
        strangers(server.port, 6) as many,
        strangers(server.port, 2, address="127.0.0.3"),
    ):
        await asyncio.sleep(0.2)
        assert [await is_open(stream) for stream in few] == [True] * 2
        assert [await is_open(stream) for stream in many] == [False] * 2 + [True] * 4


async def test_a_crowd_comes_in_slowly_while_a_session_goes_on_and_all_are_served(monkeypatch):
    turn_s = 0.2
    monkeypatch.setattr(mmt.link.serving.accepting, "_TURN_S", turn_s)
    async with leader() as server:

        async def crowd_s():
            started_s = time.monotonic()
            async with strangers(
                server.port, 10, b"GET /health HTTP/1.1\r\nHost: a\r\n\r\n"
            ) as all_:
                await asyncio.gather(*(reader.readline() for reader, _ in all_))
            return time.monotonic() - started_s

        alone_s = min([await crowd_s() for _ in range(3)])
        async with follower(server.port, access=Access(TOKEN)):
            await until(lambda: server.connected)
            assert await crowd_s() > 8 * turn_s  # the first may come between two turns
            waiting = asyncio.create_task(crowd_s())
            await asyncio.sleep(2 * turn_s)
        await until(lambda: not server.connected)
        ended_s = time.monotonic()
        await waiting
        assert time.monotonic() - ended_s < 5 * turn_s  # nobody waits when nothing is disturbed
        assert alone_s < 8 * turn_s


@pytest.mark.parametrize("kind", ["tokens", "pings"])
async def test_a_follower_connects_anew_beside_strangers_of_its_address(kind):
    over = threading.Event()

    def disturb(port):
        while not over.is_set():
            disturbing.send_as_stranger("127.0.0.1", port, kind)

    async with (
        leader() as server,
        follower(server.port, access=Access(TOKEN), run_id="the follower's"),
    ):
        disturbers = [asyncio.create_task(asyncio.to_thread(disturb, server.port)) for _ in "ab"]
        try:
            await asyncio.sleep(0.5)
            assert server.connected
            await connects_within(server.port, 5.0)  # it knows that its first connection is dead
        finally:
            over.set()
            await asyncio.gather(*disturbers)


@pytest.mark.parametrize("kind", list(disturbing.KINDS))
async def test_no_stranger_sends_more_than_a_hello_needs(kind):
    async with leader() as server, asyncio.timeout(15):
        await asyncio.to_thread(disturbing.send_as_stranger, "127.0.0.1", server.port, kind)
        await connects_within(server.port, 5.0)


async def closes(stream):
    """Whether the leader closes a connection within five seconds, after whatever it says."""
    try:
        async with asyncio.timeout(5):
            await stream[0].read()
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


@pytest.mark.parametrize(
    "says",
    [
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 900000\r\n\r\n" + bytes(GATE_BYTES),
        UPGRADE + b"\x01\x80\0\0\0\0" + b"\x00\x80\0\0\0\0" * (GATE_BYTES // 6),
        UPGRADE + b"\x89\x80\0\0\0\0" * 5,
        b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 20,
    ],
    ids=["bytes", "pieces", "pings", "requests"],
)
async def test_who_sends_more_than_a_hello_needs_is_closed_before_the_time_is_over(says):
    async with leader() as server, strangers(server.port, 1, says) as (one,):
        assert await closes(one)


async def test_the_longest_hello_fits_through_the_gate():
    notes = LeaderNotes()
    annotations = bytes(MAX_ANNOTATIONS_BYTES)
    async with (
        leader(notes) as server,
        follower(server.port, access=Access(TOKEN), annotations=annotations) as client,
    ):
        for first in range(0, 4000, 100):  # and what it sends then is not limited
            client.send_frames(frames(first, 100))
            await asyncio.sleep(0.005)
        await until(lambda: notes.sequences == list(range(4000)))
    assert notes.hellos[0].annotations == annotations


@given(data=st.lists(st.binary(min_size=1, max_size=20_000), max_size=8), opens=st.booleans())
@settings(max_examples=30)
def test_a_gate_hands_on_all_bytes_in_order_and_in_slices(data, opens):
    handed = []

    class Taking(asyncio.Protocol):
        def data_received(self, data):
            handed.append(data)

    async def run():
        loop = asyncio.get_running_loop()
        ours, other = socket.socketpair()
        gate = Gate(Taking())
        transport, _ = await loop.connect_accepted_socket(lambda: gate, ours)
        whole = b"".join(data)[:GATE_BYTES]
        with other:
            other.setblocking(False)
            sending = asyncio.create_task(loop.sock_sendall(other, whole))
            if opens:
                await asyncio.sleep(0.002)
                assert max(map(len, handed), default=0) <= 4096
                gate.open()
            async with asyncio.timeout(5):
                while sum(map(len, handed)) < len(whole):
                    await asyncio.sleep(0.001)
            await sending
            transport.abort()
            await asyncio.sleep(0)
        assert b"".join(handed) == whole
        if not opens:
            assert max(map(len, handed), default=0) <= 4096

    asyncio.run(run())


async def test_a_page_that_shows_the_token_keeps_its_connection():
    says = f"GET /none HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode()
    async with leader() as server, strangers(server.port, 1, says) as (page,):
        answer = await page[0].readuntil(b"\r\n\r\n")
        assert answer.split()[1] == b"404"
        async with strangers(server.port, 100):
            page[1].write(says)
            assert b" 404 " in await page[0].readuntil(b"\r\n\r\n")


async def test_without_descriptors_the_leader_waits_and_then_accepts(monkeypatch):
    loop, calls = asyncio.get_running_loop(), 0
    accept, lacking_until_s = loop.sock_accept, time.monotonic() + 0.5

    async def sock_accept(listening):
        nonlocal calls
        calls += 1
        if time.monotonic() < lacking_until_s:
            raise OSError(errno.EMFILE, "Too many open files")
        return await accept(listening)

    monkeypatch.setattr(loop, "sock_accept", sock_accept)
    async with leader() as server:
        await connects_within(server.port, 10.0)
    assert 2 <= calls < 20


async def test_strangers_fill_no_log(caplog):
    caplog.set_level(logging.INFO)
    notes, malformed = LeaderNotes(), b"GET / HTTP/1.1\r\nbad\r\n\r\n"
    began_s = time.monotonic()
    async with leader(notes) as server:
        async with follower(server.port, access=Access(TOKEN)) as client:
            async with strangers(server.port, 200):
                client.send_frames(frames(0))
                await until(lambda: notes.sequences == [0])
            assert notes.losses == []  # whoever was let in stays
        await until(lambda: not server.connected)
        async with strangers(server.port, 300):
            for _ in range(40):
                with pytest.raises(MmtError, match="the token is missing or wrong"):
                    async with follower(server.port):
                        pass
                async with strangers(server.port, 1, malformed) as (one,):
                    await one[0].read()
    refusals = [line for line in caplog.messages if "refused a follower" in line]
    room = [line for line in caplog.messages if "too many connections" in line]
    most = 3 + time.monotonic() - began_s  # of each one a second
    assert 1 <= len(refusals) < most
    assert 1 <= len(room) < most
    assert len(caplog.messages) < 3 * most
    assert "Traceback" not in caplog.text


async def test_a_name_with_an_address_that_the_machine_lacks_is_listened_on_at_the_other(
    monkeypatch,
):
    loop = asyncio.get_running_loop()
    absent = (socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("2001:db8::1", 0, 0, 0))
    present = (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 0))
    for found in ([absent, present], [present, absent]):

        async def names(*_, found=found, **__):
            return found

        with monkeypatch.context() as patched:
            patched.setattr(loop, "getaddrinfo", names)
            async with leader() as server:
                patched.undo()
                await connects_within(server.port, 5.0)


async def test_a_port_that_is_taken_on_one_of_two_addresses_is_an_error(monkeypatch):
    loop = asyncio.get_running_loop()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]

        async def names(*_, **__):
            return [
                (socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, port))
                for address in ("127.0.0.2", "127.0.0.1")
            ]

        monkeypatch.setattr(loop, "getaddrinfo", names)
        with pytest.raises(MmtError, match=r"cannot listen on .* \(Address already in use\)"):
            async with leader():
                pass
    with socket.create_server(("127.0.0.2", port)):
        pass  # it was let go


async def test_a_link_is_not_passed_on_to_another_leader():
    notes = LeaderNotes()

    async def pass_on(request):
        raise web.HTTPTemporaryRedirect(f"http://127.0.0.1:{server.port}{request.path_qs}")

    async with leader(notes) as server:
        application = web.Application()
        application.router.add_get("/socket.io/", pass_on)
        runner = web.AppRunner(application)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        try:
            with pytest.raises(MmtError, match="which is not followed"):
                await connects_within(int(runner.addresses[0][1]), 1.0)
        finally:
            await runner.cleanup()
    assert notes.hellos == []


@pytest.fixture
def low_limit(monkeypatch):
    for name, value in {"MESSAGES_PER_PERIOD": 1, "BURST_S": 0.5, "GRACE_S": 0.05}.items():
        monkeypatch.setattr(mmt.link.incoming, name, value)


@pytest.mark.usefixtures("low_limit")
async def test_a_follower_that_floods_is_cut_off_and_the_next_is_served(monkeypatch):
    notes = LeaderNotes()
    rubbish = encode_event("frames", b"x")
    async with leader(notes) as server, stock_client(server.port, TOKEN) as client:
        with contextlib.suppress(ConnectionError, RuntimeError, aiohttp.ClientError):
            async with asyncio.timeout(30):
                while not notes.losses:
                    for _ in range(200):
                        await client.eio.ws.send_bytes(rubbish)
                    await asyncio.sleep(0)
        await until(lambda: notes.losses)
        assert notes.losses[0].startswith("it sent more than 1000 messages")
        assert server.statistics.rejected["too fast"] > 0
        # what the first owes would take 0.5 s
        monkeypatch.setattr(server.endpoint.rate_limit, "_due_ns", 0)
        async with follower(server.port, access=Access(TOKEN)) as good:
            good.send_frames(frames(0))
            await until(lambda: notes.sequences == [0])
    assert notes.errors == []


@pytest.mark.usefixtures("low_limit")
async def test_a_leader_that_floods_ends_the_follower_with_a_reason():
    notes = FollowerNotes()
    async with leader() as server, follower(server.port, notes, Access(TOKEN)) as client:
        await until(lambda: server.can_send)
        async with asyncio.timeout(30):
            while not notes.errors:
                server.endpoint.outbox.put(1, encode_event("commands", b"x"))
                server.endpoint.outbox.put(1, encode_event("commands", b"x"))
                await asyncio.sleep(0)
        assert str(notes.errors[0]).startswith("the leader was cut off: it sent more than")
        assert client.statistics.rejected["too fast"] > 0


async def test_who_is_not_let_in_may_not_stay(monkeypatch):
    monkeypatch.setattr(mmt.link.serving.sockets, "HANDSHAKE_S", 0.3)
    async with leader() as server, aiohttp.ClientSession() as session:
        url = f"http://127.0.0.1:{server.port}/socket.io/?EIO=4&transport=websocket"
        async with (
            follower(server.port, access=Access(TOKEN)) as good,
            session.ws_connect(url) as silent,
        ):
            assert (await silent.receive()).type is aiohttp.WSMsgType.TEXT  # the handshake
            async with asyncio.timeout(10):
                while not (await silent.receive()).type & 0x8:  # until it is closed
                    pass
            assert silent.closed
            assert good.connected
