"""Asking for control and sending motion over real connections; and what makes no sense."""

from contextlib import asynccontextmanager

import msgpack
import numpy as np
import pytest
import socketio
from hypothesis import given
from hypothesis import strategies as st
from service_runs import small_scene
from sharing_samples import listening, refused, shared, until

from mmt.contact.estimation import ContactModel
from mmt.contact.rendering import LocalContact
from mmt.core.errors import InputError
from mmt.leader.service import Leader
from mmt.link.access import Access
from mmt.link.protocol import encode_event
from mmt_share.control_messages import (
    CONTROL,
    MOST_RECORDS,
    MOTION_DTYPE,
    ControlNews,
    SharedContact,
    decode_motion,
    encode_motion,
)
from mmt_share.operator import OperatorClient
from mmt_share.parts.control import ControlPart
from mmt_share.tables import CONTROL_VARIABLE

TOKEN = Access("0123456789abcdef" * 2)
HOLD = (1.0, 2.0, 3.0)
NOTHING = lambda _: None  # noqa: E731 - a name for a callback


@asynccontextmanager
async def controlled():
    """Share, and let operators ask; gives what the leader would be told."""
    told = []
    async with shared() as sharing:
        sharing.server.admit_operators(TOKEN, lambda **line: told.append(line))
        yield sharing, told


@asynccontextmanager
async def operating(sharing, **settings):
    client = OperatorClient(TOKEN, NOTHING)
    async with listening(sharing.url, client, **settings) as heard:
        yield client, heard


def kinds(told):
    return [line["control"] for line in told]


def send(sharing, who, news):
    sharing.server.operators.send(who, news.encode())


async def test_an_operator_asks_is_given_control_and_its_motion_arrives():
    async with controlled() as (sharing, told), operating(sharing, name="ann") as (client, _):
        await until(lambda: told)
        assert told == [{"control": "ask", "who": 1, "name": "ann"}]
        assert sharing.server.operators is not None
        client.put(1, HOLD, HOLD, 1.0, contact=True)  # nobody has given it anything yet
        sharing.server.operators.admit_motion(1)
        send(sharing, 1, ControlNews("given", 4, HOLD, 20.0))
        await until(lambda: client.operates)
        assert client.news == ControlNews("given", 4, HOLD, 20.0)
        model = ContactModel(0.001, 2e3, damping_n_s_m=1.5)
        send(sharing, 1, SharedContact(model, 2, 3.3))
        await until(lambda: client.contact)
        assert client.contact == SharedContact(model, 2, 3.3)
        for k in range(25):
            client.put(1000 + k, (float(k), 0.0, -1.0), (5.0, 0.0, 0.0), 1.5, contact=True)
        await until(lambda: kinds(told).count("motion") == 2)
        grant, records = decode_motion(bytes.fromhex(told[-1]["data"]))
        assert grant == 4
        assert records["position_mm"][:, 0].tolist() == list(range(10, 20))
        assert records["time_ns"].tolist() == list(range(1010, 1020))
        send(sharing, 1, ControlNews("ended", 4, why="taken back"))
        await until(lambda: not client.operates)
        client.put(1, HOLD, HOLD, 1.0, contact=True)
        assert client.records == 20
    assert kinds(told)[-1] == "gone"


async def test_operators_of_one_name_or_none_are_told_apart():
    async with controlled() as (sharing, told):
        for name in ("ann", "ann 2", "", "ann"):
            async with operating(sharing, name=name):
                await until(lambda: kinds(told)[-1:] == ["ask"])
            await until(lambda: kinds(told)[-1:] == ["gone"])
        async with operating(sharing, name="ann"), operating(sharing, name="ann"):
            await until(lambda: kinds(told).count("ask") == 6)
    names = [line["name"] for line in told if line["control"] == "ask"]
    assert names[:4] == ["ann", "ann 2", "operator 3", "ann 4"]
    assert len(set(names)) == 6


async def test_who_has_no_right_or_no_token_does_not_operate():
    async with controlled() as (sharing, told):
        for access in (Access("0123456789abcdef" * 3), Access()):
            operator = OperatorClient(access, NOTHING)
            await refused("no control is given to this listener", sharing.url, operator)
        stranger = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        auth = {"sharing": 1, "role": "listener", "control_token": TOKEN.token}
        await stranger.connect(sharing.url, auth=auth, transports=["websocket"])
        for event in ("ask", "release", "motion"):
            await stranger.emit(event, encode_motion(0, np.zeros(1, MOTION_DTYPE)))
        await stranger.emit("again", None)
        await until(lambda: sharing.relay.listeners)
        await stranger.disconnect()
        assert told == []
    async with shared() as sharing:
        await refused(r"needs \[control\]", sharing.url, OperatorClient(TOKEN, NOTHING))


async def test_only_the_motion_of_the_admitted_operator_is_handed_on():
    async with (
        controlled() as (sharing, told),
        operating(sharing, name="a") as (first, _),
        operating(sharing, name="b") as (second, _),
    ):
        await until(lambda: kinds(told).count("ask") == 2)
        operators = sharing.server.operators
        operators.admit_motion(2)
        for who, client in ((1, first), (2, second)):
            send(sharing, who, ControlNews("given", 1, HOLD))
            await until(lambda client=client: client.operates)
            for k in range(30):
                client.put(k, HOLD, HOLD, 0.0, contact=False)
        await until(lambda: kinds(told).count("motion") == 3 and operators.refused == 3)
        assert {line["who"] for line in told if line["control"] == "motion"} == {2}


async def test_control_is_released_and_asked_for_again_at_once():
    async with controlled() as (sharing, told), operating(sharing) as (client, _):
        await until(lambda: told)
        client.release()
        assert not client.wants
        await until(lambda: kinds(told) == ["ask", "release"])
        for _ in range(5):  # one request a second is heard, the next one waits
            client.request_control()
        await until(lambda: kinds(told) == ["ask", "release", "ask"])
        client.request_control()
        client.release()
        await until(lambda: kinds(told)[3:] == ["release"])
        assert not sharing.server.operators._waiting
        send(sharing, 1, ControlNews("refused", why="not now"))
        await until(lambda: not client.wants)


async def test_a_lost_connection_is_told_and_the_operator_asks_anew():
    async with controlled() as (sharing, told), operating(sharing) as (client, heard):
        await until(lambda: told)
        sharing.server.operators.admit_motion(1)
        send(sharing, 1, ControlNews("given", 1, HOLD))
        await until(lambda: client.operates)
        line = heard.client._connection.line
        line.drop()
        await until(lambda: kinds(told)[-2:] == ["gone", "ask"])
        assert told[-1]["who"] == 2
        assert not client.operates


async def test_nonsense_from_an_operator_changes_nothing_and_ends_nothing_but_itself():
    async with controlled() as (sharing, told), operating(sharing) as (client, _):
        await until(lambda: told)
        stranger = socketio.AsyncClient(serializer="msgpack", reconnection=False)
        auth = {"sharing": 1, "role": "operator", "control_token": TOKEN.token, "name": 5}
        await stranger.connect(sharing.url, auth=auth, transports=["websocket"])
        sharing.server.operators.admit_motion(2)
        for event, argument in (
            ("motion", None),
            ("motion", "text"),
            ("motion", {"a": 1}),
            ("motion", bytes(5000)),
            ("ask", {"who": 1}),
            ("ask", bytes(10)),
            ("release", [[[]]]),
        ):
            await stranger.emit(event, argument)
        await until(lambda: "release" in kinds(told))
        await stranger.disconnect()
        await until(lambda: kinds(told)[-1] == "gone")
        assert "motion" not in kinds(told)
        send(sharing, 1, ControlNews("given", 1, HOLD))
        await until(lambda: client.operates)


async def test_nonsense_from_a_leader_is_counted_and_left_out():
    good = msgpack.unpackb(ControlNews("given", 1, HOLD).encode())["data"][1]
    contact = msgpack.unpackb(SharedContact(ContactModel(0.0, 1e3), 2, 1.0).encode())["data"][1]
    model, nan = contact["model"], float("nan")
    contacts = (
        {"normal": 3}, {"limit_n": 1e9}, {"model": {}}, {"model": {**model, "exponent": 1e9}},
        {"model": {**model, "stiffness_n_m": nan}},
    )  # fmt: skip
    bad = [(CONTROL, None), (CONTROL, "given"), (CONTROL, {**good, "why": b"x"}), ("contact", 7)]
    bad += [("contact", {**contact, **changes}) for changes in contacts]
    async with controlled() as (sharing, told), operating(sharing) as (client, _):
        await until(lambda: sharing.relay.listeners and told)
        (listener,) = sharing.relay.listeners.values()
        for event, argument in bad:
            listener.queue_message(encode_event(event, argument))
        await until(lambda: client.rejected == len(bad))
        assert client.news is None
        assert client.contact is None


@given(st.binary(max_size=200) | st.integers(0, 3).map(lambda n: bytes(4 + 37 * n)))
def test_any_bytes_are_motion_or_are_refused(data):
    try:
        _, records = decode_motion(data)
    except InputError:
        return
    assert 1 <= len(records) <= MOST_RECORDS
    assert np.isfinite(records["position_mm"]).all()
    assert np.isfinite(records["velocity_mm_s"]).all()
    assert np.abs(records["position_mm"]).max() <= 10_000.0
    assert (np.diff(records["time_ns"]) > 0).all()


def test_a_message_of_motion_comes_back_as_it_was():
    records = np.zeros(3, MOTION_DTYPE)
    records["time_ns"] = [5, 6, 8]
    records["force_n"] = 2.5
    event, data = msgpack.unpackb(encode_motion(9, records))["data"]
    grant, found = decode_motion(data)
    assert (event, grant) == ("motion", 9)
    assert found.tobytes() == records.tobytes()
    with pytest.raises(InputError, match="1 to 100"):
        decode_motion(data[:-1])
    for name, value in (("position_mm", np.nan), ("velocity_mm_s", np.inf), ("force_n", 2e3)):
        broken = records.copy()
        broken[name] = value
        with pytest.raises(InputError, match="out of range"):
            decode_motion(msgpack.unpackb(encode_motion(9, broken))["data"][1])
    records["time_ns"] = [5, 5, 8]
    with pytest.raises(InputError, match="grow"):
        decode_motion(msgpack.unpackb(encode_motion(9, records))["data"][1])


@given(
    st.fixed_dictionaries(
        {
            "surface_m": st.floats(-10.0, 10.0),
            "stiffness_n_m": st.floats(0.0, 1e12) | st.sampled_from([1e-300, 1e-200, 1e-9]),
            "exponent": st.floats(0.5, 3.0),
            "damping_n_s_m": st.floats(0.0, 1e4),
            "dissipation_s_m": st.floats(0.0, 100.0),
        }
    )
)
def test_any_contact_that_is_taken_can_be_rendered(given_model):
    message = {"model": given_model, "normal": 2, "limit_n": 3.0}
    try:
        model = SharedContact.from_message(message).model
    except InputError:
        return
    rendering = LocalContact()
    for target in (model, ContactModel(0.0, 1e3), model):
        rendering.set_target(target)
        assert np.isfinite([rendering.step(depth_m) for depth_m in (-1.0, 0.001, 2.0)]).all()


GIVEN = {"state": "given", "grant": 1, "hold_mm": [1, 2.0, 3], "recovery_mm_s": 5, "why": ""}


@pytest.mark.parametrize(
    "changed",
    [
        *({"state": x} for x in ("given\n", "taken", None)),
        *({"grant": x} for x in (-1, 2**32, "1", 1.5)),
        *({"hold_mm": [0.0, x, 0.0]} for x in (float("nan"), 1e5, "1", None)),
        *({"recovery_mm_s": x} for x in (0.0, float("inf"), "5")),
    ],
)
def test_control_is_told_whole_or_not_at_all(changed):
    assert ControlNews.from_message(GIVEN) == ControlNews("given", 1, (1.0, 2.0, 3.0), 5.0)
    for absent in GIVEN:
        with pytest.raises(InputError, match=f"it lacks {absent}"):
            ControlNews.from_message({key: GIVEN[key] for key in GIVEN if key != absent})
    with pytest.raises(InputError, match=f"malformed: {next(iter(changed))}"):
        ControlNews.from_message({**GIVEN, **changed})


def test_orders_that_make_no_sense_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(CONTROL_VARIABLE, "0123456789abcdef")
    tables = {"texture": {}, "rendering": {}, "sharing": {"port": 0}, "control": {}}
    part = Leader(small_scene(tmp_path, **tables)).parts.get(ControlPart)
    control = part.orders()["control"]
    for decision in (None, 1, "gift", [], {}, ["give"]):
        with pytest.raises(InputError, match="allowed are give, refuse, take back"):
            control({"decision": decision})
    for who in (None, 1.0, "1", [1]):
        with pytest.raises(InputError, match="who is the number of a listener"):
            control({"decision": "refuse", "who": who})
