"""One follower at a time is admitted, welcomed and let go; by the handshake alone."""

import asyncio
from dataclasses import replace
from unittest.mock import Mock

import pytest
import socketio
from link_samples import CHANNELS, LeaderNotes, hello

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import frame_dtype
from mmt.core.running.process import clock_id
from mmt.link.access import Access
from mmt.link.clock_exchange import ClockResponder
from mmt.link.endpoint import Endpoint
from mmt.link.handshake import FollowerSlot, admit
from mmt.link.incoming import BlockReader

GOOD = hello(run_id="r").to_auth()
SCENE = {"access": Access(), "expected": hello()}
TOKEN = "x" * 40
WELCOME = {"protocol": 1, "clock_id": clock_id(), "session_id": "session 7"}
NETWORK = {"delay_ms": 5}


class Host:
    """A slot, and the server, its sockets and the emulated network in one."""

    application = "pages"

    def __init__(self, *, emulates=True, **callbacks):
        self.server = self.sockets = self
        self.handlers = {}
        self.on = self.handlers.__setitem__
        self.told = []
        self.sent = []
        self.admitted = []
        self.dropped = []
        self.received = []
        self.served = []
        self.restarts = 0
        self.notes = LeaderNotes()
        events = replace(self.notes.events(), **callbacks)
        reader = BlockReader(frame_dtype(CHANNELS), "frames")
        extra = Mock(event="extra", dtype=frame_dtype(CHANNELS), restart=self._restart)
        self.endpoint = Endpoint(reader, 4, 1000, events, print, extra=extra)
        self.clock = ClockResponder(reader, self.endpoint.outbox, self.received.append)
        self.slot = FollowerSlot(
            self,
            self.endpoint,
            self.clock,
            events,
            **SCENE,
            session_id="session 7",
            network=self if emulates else None,
        )
        self.slot.handle({"frames": self._receive}, {"settle": lambda: "settled"})

    def _receive(self, *arguments):
        self.received.append(arguments)

    def _restart(self):
        self.restarts += 1

    def connect(self, sid, *auth):
        self.handlers["connect"](sid, {"of": sid}, *auth)

    async def emit(self, event, payload, to):
        self.told.append((event, payload, to))

    async def disconnect(self, sid):
        self.dropped.append(sid)

    def admit(self, environ, handlers, rate_limit):
        self.admitted.append((environ["of"], handlers, rate_limit))

    def send(self, sid, environ):
        async def send(message):
            self.sent.append((sid, environ["of"], message))

        return send

    def serve(self, application, tell):
        self.served.append((application, tell))

    def payload(self):
        return NETWORK


async def spin():
    for _ in range(9):
        await asyncio.sleep(0)


@pytest.mark.parametrize("emulates", [True, False])
async def test_a_follower_is_welcomed_before_anything_else_is_sent(emulates, caplog):
    host = Host(emulates=emulates)
    host.endpoint.rate_limit.shut = True  # of the follower before
    host.connect("a", GOOD)
    assert (host.slot.sid, host.slot.hello, host.notes.hellos) == (
        "a", hello(run_id="r"), [hello(run_id="r")],
    )  # fmt: skip
    assert (host.restarts, host.clock.is_shared, host.endpoint.rate_limit.shut) == (1, True, False)
    ((of, handlers, rate_limit),) = host.admitted
    assert (of, rate_limit) == ("a", host.endpoint.rate_limit)
    handlers["frames"](b"block")
    assert host.received == [(b"block",)]
    host.endpoint.outbox.put(1, b"too early")
    await spin()
    host.endpoint.outbox.put(1, b"command")
    network = [("network", NETWORK, "a")] * emulates
    assert host.told == [("welcome", WELCOME, "a"), *network]
    assert host.sent == [("a", "a", b"command")]
    assert [application for application, _ in host.served] == ["pages"] * emulates
    for _, tell in host.served:
        await tell()
        assert host.told[2:] == network
        host.handlers["disconnect"]("a", "client disconnect")
        await tell()
        assert host.told[3:] == []
    assert caplog.messages == host.notes.errors == []


def refuse(error):
    def on_follower(_):
        raise error

    return on_follower


HELLO_MISSING = "the hello is missing: connect with an mmt follower's auth"


@pytest.mark.parametrize(
    ("auth", "error", "told", "logged"),
    [
        ((), None, HELLO_MISSING, [HELLO_MISSING]),
        ((GOOD,), MmtError("no\n" + 2000 * "!"), "no\n" + 2000 * "!", ["no\ufffd" + 1021 * "!"]),
        ((GOOD,), ZeroDivisionError("x"), "the leader failed", []),
    ],
)
async def test_who_is_refused_is_told_why(auth, error, told, logged, caplog):
    host = Host(**{"on_follower": refuse(error)} if error else {})
    for _ in range(2):  # the second one is not logged
        with pytest.raises(socketio.exceptions.ConnectionRefusedError) as caught:
            host.connect("a", *auth)
        assert caught.value.error_args == {"message": told}
    assert caplog.messages == [f"refused a follower: {line}" for line in logged]
    assert host.notes.errors == ([] if logged else [error] * 2)
    await spin()
    assert (host.slot.sid, host.restarts, host.admitted, host.told) == (None, 0, [], [])


async def test_a_follower_that_connects_anew_drops_its_earlier_connection():
    host = Host()
    host.connect("a", GOOD)
    host.connect("b", GOOD)
    assert host.notes.losses == ["it connects anew"]
    host.handlers["disconnect"]("a", "client disconnect")
    await spin()
    host.endpoint.outbox.put(1, b"command")
    with pytest.raises(socketio.exceptions.ConnectionRefusedError, match="another follower"):
        host.connect("c", hello().to_auth())
    assert (host.slot.sid, host.dropped, host.restarts) == ("b", ["a"], 2)
    assert host.sent == [("b", "b", b"command")]
    assert host.notes.losses == ["it connects anew"]


@pytest.mark.parametrize(
    ("before", "losses"),
    [
        (lambda host: None, ["the connection was closed"]),
        (lambda host: host.slot.cut_off(MmtError("it floods")), ["it floods"]),
        (lambda host: host.slot.end(), []),
        (lambda host: host.slot.close(), []),
    ],
)
async def test_a_follower_that_leaves_is_lost_unless_the_session_is_over(before, losses):
    host = Host()
    host.connect("a", GOOD)
    await spin()
    before(host)
    host.handlers["disconnect"]("b", "transport close")
    assert (host.slot.sid, host.endpoint.outbox.is_open) == ("a", True)
    host.handlers["disconnect"]("a", "transport close")
    assert (host.slot.sid, host.endpoint.outbox.is_open) == (None, False)
    assert (host.notes.losses, host.notes.errors) == (losses, [])


async def test_a_leader_that_closes_welcomes_nobody():
    host = Host()
    host.connect("a", GOOD)
    host.slot.close()
    await spin()
    assert host.told == []
    assert not host.endpoint.outbox.is_open


def test_a_hello_is_admitted_with_the_token_if_the_place_is_free_or_its_own():
    one, scene = (
        hello(run_id="a", extra="e"),
        {"access": Access(TOKEN), "expected": hello(extra="e")},
    )
    for occupant in (None, one):
        assert admit({**one.to_auth(), "token": TOKEN}, occupant, **scene) == one
    for auth in (None, one.to_auth(), {"token": "y" * 40}):
        with pytest.raises(MmtError, match=r"^the token is missing or wrong: "):
            admit(auth, None, **scene)
    for auth, occupant in ((GOOD, one), (hello().to_auth(), hello())):
        with pytest.raises(MmtError) as caught:
            admit(auth, occupant, **SCENE)
        told = "another follower is connected: one leader serves one follower"
        assert str(caught.value) == told


@pytest.mark.parametrize(
    ("auth", "scene", "sentence"),
    [
        ({"rate_hz": 500}, {}, "streams at 500 Hz, the leader's scene expects 1000 Hz"),
        (
            {"channels": ["force", "acceleration"]},
            {},
            "sends force, acceleration, the leader's scene needs position, force",
        ),
        (
            {"channels": ["acceleration"], "protocol": 2, "samples_per_frame": 5},
            {"channels": ("acceleration",)},
            "sends 5 samples of acceleration a frame, the leader's scene needs 1 "
            "(acceleration_rate_hz of [session])",
        ),
        (
            {},
            {"extra": "energy"},
            "has nothing beside its frames, the leader's scene energy "
            "(method of [force_feedback], hand_force of [handle])",
        ),
        (
            {"extra": 21 * "x"},
            {},
            f"has {20 * 'x'} beside its frames, the leader's scene nothing "
            "(method of [force_feedback], hand_force of [handle])",
        ),
    ],
)
def test_a_follower_of_another_scene_is_refused(auth, scene, sentence):
    with pytest.raises(InputError) as caught:
        admit({**GOOD, **auth}, None, access=Access(), expected=hello(**scene))
    assert str(caught.value) == f"the follower {sentence}: use the same scene on both"


async def test_the_place_is_one_followers_until_it_leaves(caplog):
    host = Host()
    slot, heard = host.slot, []
    assert (slot.hello, slot.fault) == (None, "")
    for sid, other in (("a", "b"), ("b", "a")):
        assert (slot.in_session, slot.expects(sid)) == (False, False)
        slot.assign(sid, hello(source=sid))
        assert (slot.in_session, slot.expects(sid), slot.expects(other)) == (True, True, False)
        assert (slot.sid, slot.hello, slot.fault) == (sid, hello(source=sid), "")
        heard += [host.handlers["settle"](each) for each in (sid, other)]
        host.handlers["frames"](other, b"block")
        slot.cut_off(MmtError("it floods"))
        assert slot.fault == "it floods"
        slot.end()
        assert (slot.sid, slot.in_session, slot.expects(sid)) == (sid, False, False)
        host.handlers["frames"](sid, b"after the end")
        async with asyncio.timeout(5.0):
            assert not await slot.wait_until_free(0.001)
            waiting = asyncio.create_task(slot.wait_until_free(60.0))
            await spin()
            slot.release()
            assert await waiting
        assert (slot.sid, slot.hello) == (None, None)
    assert (heard, host.received) == (["settled", None] * 2, [])
    assert caplog.messages == ["the follower is cut off: it floods"] * 2
