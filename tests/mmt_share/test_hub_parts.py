"""Whose turn it is among hubs, and what a hub makes of messages in any number and order."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sharing_samples import about, model_of

from mmt.core.errors import InputError, without_secrets
from mmt.scene.files import load_scene
from mmt_share.client import ListenerClient
from mmt_share.commands.hub import make_room
from mmt_share.hub.channel import HubChannel
from mmt_share.hub.copy import HubCopy
from mmt_share.hub.peers import FIRST_S, LOST_S, Heartbeat, Peers
from mmt_share.hub.scene import load_hub_scene
from mmt_share.messages import CHANGE, MODEL, WELCOME
from mmt_share.parts.sharing import ModelPublisher
from mmt_share.relay import ListenerFeed, Relay
from mmt_share.tables import Listening


def beat(name, **what):
    return Heartbeat(name, f"http://{name}:1", **what)


def test_the_oldest_hub_feeds_once_it_has_listened_for_others():
    peers = Peers("b", 0.0)
    assert not peers.should_feed(0.5 * FIRST_S, feeding=False)
    assert peers.should_feed(FIRST_S, feeding=False)


def test_a_younger_hub_waits_for_each_older_one():
    peers = Peers("c", 0.0)
    for name in "abd":
        peers.record_heartbeat(beat(name), 1.0)
    turns = [peers.should_feed(1.0 + 0.1 * step, feeding=False) for step in range(10)]
    assert not any(turns)
    for name in "abd":
        peers.record_heartbeat(beat(name), FIRST_S + 1.0)
    assert not peers.should_feed(FIRST_S + 1.9, feeding=False)
    assert peers.should_feed(FIRST_S + 2.0, feeding=False)


def test_of_two_that_feed_the_older_one_stays():
    peers = Peers("b", 0.0)
    peers.record_heartbeat(beat("b", feeding=True), 5.0)  # as it hears itself
    assert peers.alive(5.0) == []
    peers.record_heartbeat(beat("c", feeding=True), 5.0)
    assert peers.should_feed(5.0, feeding=True)
    peers.record_heartbeat(beat("a", feeding=True), 5.0)
    assert not peers.should_feed(5.0, feeding=True)


def test_a_hub_without_a_beat_is_gone_and_so_is_one_that_leaves():
    peers = Peers("b", 0.0)
    peers.record_heartbeat(beat("a", feeding=True), 5.0)
    peers.record_heartbeat(beat("c"), 5.0)
    assert [each.id for each in peers.alive(5.0 + LOST_S)] == ["a", "c"]
    assert not peers.should_feed(5.0 + LOST_S, feeding=False)
    peers.record_heartbeat(beat("c", leaving=True), 5.0 + LOST_S)
    assert [each.id for each in peers.alive(5.0 + LOST_S)] == ["a"]
    assert peers.should_feed(5.1 + LOST_S, feeding=False)
    assert peers.alive(5.1 + LOST_S) == []


def test_beats_go_over_the_wire():
    one = Heartbeat("a", "http://a:1", 3, True, "abc", 7)
    assert Heartbeat.from_message(vars(one)) == one
    for malformed in (None, [], {"id": "a"}, {**vars(one), "number": "x"}):
        with pytest.raises(InputError, match="beat is malformed"):
            Heartbeat.from_message(malformed)
    for address in ("javascript:alert(1)", "ftp://host", "", "//host", "data:x"):
        with pytest.raises(InputError, match="beat is malformed: address"):
            Heartbeat.from_message({**vars(one), "address": address})


class Leader:
    """A leader's messages as a hub gets them."""

    def __init__(self, session_id="abc"):
        self.publisher = ModelPublisher()
        self.welcome = {"session_id": session_id, "name": "a", "rate_hz": 1000}

    def publish(self, count):
        import msgpack

        published = self.publisher.publish(model_of(count), about(count))
        whole = msgpack.unpackb(published.whole)["data"][1]
        change = published.change and msgpack.unpackb(published.change)["data"][1]
        return whole, change


@pytest.fixture
def copy():
    one = HubCopy(Relay(), 20.0)
    one.receive(WELCOME, Leader().welcome)
    return one


def test_what_two_hubs_feed_is_taken_once(copy):
    leader = Leader()
    relay = copy._relay
    (first, _), (second, change) = leader.publish(10), leader.publish(11)
    listener = ListenerFeed(relay)
    for event, message in ((MODEL, first), (MODEL, first), (CHANGE, change), (CHANGE, change)):
        copy.receive(event, message)
        copy.receive(WELCOME, leader.welcome)
    copy.receive(MODEL, second)
    copy.receive(MODEL, first)
    assert (copy.number, copy.lacking) == (2, False)
    assert listener.next() is not None
    assert listener.next() is None


def test_where_a_change_is_missing_the_whole_is_asked_for_and_taken(copy):
    leader = Leader()
    (first, _), (_, missing), (whole, change) = (leader.publish(count) for count in (10, 11, 12))
    assert missing is not None
    copy.receive(MODEL, first)
    copy.receive(CHANGE, change)
    assert (copy.number, copy.lacking) == (1, True)
    copy.receive(MODEL, whole)
    assert (copy.number, copy.lacking) == (3, False)
    assert copy.replica.message() == whole


def test_a_late_hub_has_the_same_whole_as_one_that_took_every_change(copy):
    leader = Leader()
    first, _ = leader.publish(10)
    copy.receive(MODEL, first)
    for count in (12, 13):
        newest, change = leader.publish(count)
        copy.receive(CHANGE, change)
    late = HubCopy(Relay(), 20.0)
    late.receive(WELCOME, leader.welcome)
    late.receive(MODEL, copy.replica.message())
    assert (late.number, late.lacking) == (3, False)
    assert late.replica.message() == newest


def test_another_session_begins_anew_and_a_model_of_an_unknown_one_is_not_taken():
    copy = HubCopy(Relay(), 20.0)
    whole, _ = Leader().publish(10)
    copy.receive(MODEL, whole)
    assert (copy.number, copy.lacking) == (0, True)
    copy.receive(WELCOME, Leader().welcome)
    assert not copy.lacking
    copy.receive(MODEL, whole)
    copy.receive(WELCOME, Leader("def").welcome)
    assert (copy.number, copy.session_id) == (0, "def")


def test_what_makes_no_sense_is_survived(copy):
    first, _ = Leader().publish(10)
    copy.receive(MODEL, first)
    for event in (MODEL, CHANGE, "state", "nothing"):
        for message in (None, 7, b"abc", {}, {"session_id": "abc", "number": 3}):
            copy.receive(event, message)
            assert copy.replica.message() == first, (event, message)


async def test_a_listener_keeps_addresses_of_hubs_that_it_may_turn_to():
    client = ListenerClient(Listening(url="http://a:1"))
    for sent, kept in (
        (["http://b:1", "http://c:2"], ["http://b:1", "http://c:2"]),
        (["https://b:1", "ftp://b", "", 7, None, "http://", "http://b:1"], ["http://b:1"]),
        ([f"http://{'b' * 300}:1"], []),
        ("http://b:1", []),
        ([f"http://b:{port}" for port in range(1, 100)], [f"http://b:{p}" for p in range(1, 65)]),
    ):
        client._take_hubs(sent)
        assert client.hubs == kept


def test_tables_of_a_hub_come_from_file_environment_and_flags(tmp_path, monkeypatch):
    file = tmp_path / "hub.toml"
    file.write_text('[hub]\ngroup = "a"\n[sharing]\nmost = 7\nport = 1\ntoken_file = "token"\n')
    (tmp_path / "token").write_text("0123456789abcdef")
    monkeypatch.setenv("MMT_HUB__REDIS", "redis://b:1")
    monkeypatch.setenv("MMT_LINK__PORT", "9")
    scene = load_hub_scene(file, {"sharing.port": 2, "hub.address": None})
    assert (scene.hub.group, scene.hub.redis, scene.sharing.most) == ("a", "redis://b:1", 7)
    assert (scene.sharing.port, scene.hub.address) == (2, None)
    assert scene.sharing.token_file == tmp_path / "token"
    monkeypatch.setenv("MMT_SHARING__MOST", "0")
    with pytest.raises(InputError, match=r"environment variable MMT_SHARING__MOST: sharing\.most"):
        load_hub_scene(None, {})
    monkeypatch.delenv("MMT_SHARING__MOST")
    with pytest.raises(InputError, match=r"^--port: sharing\.port is 70000"):
        load_hub_scene(file, {"sharing.port": 70000}, {"sharing.port": "--port"})
    file.write_text("[texture]\n")
    with pytest.raises(InputError, match="texture is not a key; allowed are hub, sharing, list"):
        load_hub_scene(file, {})
    load_scene("demo")  # which a hub's variables do not concern


@pytest.mark.parametrize(
    ("limits", "listeners", "raised", "says"),
    [
        ((1024, 4096), 100, None, ""),
        ((1024, 4096), 200, 1600, ""),
        ((1024, 4096), 1000, 4096, "room for 512 listeners and not for 1000: .*ulimit -n 8000"),
    ],
)
def test_as_many_files_may_be_open_as_listeners_need(monkeypatch, limits, listeners, raised, says):
    resource = pytest.importorskip("resource")
    now = [limits]
    monkeypatch.setattr(resource, "getrlimit", lambda _: now[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, pair: now.append(pair))
    said = []
    make_room(listeners, said.append)
    assert now[1:] == ([] if raised is None else [(raised, limits[1])])
    assert bool(said) == bool(says)
    assert re.search(says, "".join(said))


SECRETS = st.text(st.sampled_from("abcXYZ019:@/%!$&=?"), min_size=6, max_size=20).map(
    "5ecret".__add__
)


@given(secret=SECRETS, scheme=st.sampled_from(["redis", "rediss", "http", "unix"]))
@settings(max_examples=60)
def test_a_password_of_redis_is_never_printed(secret, scheme):
    for url in (f"{scheme}://:{secret}@host:port", f"{scheme}://ann:{secret}@host:port/0"):
        assert secret not in without_secrets(f"{url!r}: it is wrong")
        assert without_secrets(url).startswith(f"{scheme}://***@host")
        said = ""
        try:
            scene = load_hub_scene(None, {"hub.redis": url}, {})
            said = repr(scene)
            HubChannel(scene.hub.redis, "group", pytest.fail)
        except InputError as error:
            said += str(error)
        assert "5ecret" not in said
