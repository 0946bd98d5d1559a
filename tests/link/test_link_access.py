"""Who may connect: tokens, certificates, and what is listened on without them."""

import os
import re
import ssl
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp
import pytest
import trustme
import yarl
from link_samples import CHANNELS, LeaderNotes, follower, frames, leader, until
from wire_relay import Wire

from mmt.core.errors import InputError, MmtError
from mmt.link.access import FOLLOWERS, TOKEN_VARIABLE, Access, check_listening, check_scheme
from mmt.link.server import LeaderServer
from mmt.scene import Link
from mmt_share.client import ListenerClient
from mmt_share.relay import Relay
from mmt_share.server import SharingServer
from mmt_share.tables import Listening, Sharing

TOKEN = "a token that nobody guesses"


@pytest.fixture(scope="module")
def pem(tmp_path_factory):
    """Gives the path of a PEM file of our authority, or of theirs, by its name."""
    folder = tmp_path_factory.mktemp("certificates")
    for owner in ("our", "their"):
        authority = trustme.CA()
        authority.cert_pem.write_to_path(folder / f"{owner}-authority.pem")
        for name, address in (("leader", "127.0.0.1"), ("follower", "follower")):
            issued = authority.issue_cert(address)
            issued.private_key_pem.write_to_path(folder / f"{owner}-{name}-key.pem")
            for index, part in enumerate(issued.cert_chain_pems):
                part.write_to_path(folder / f"{owner}-{name}.pem", append=index > 0)
    return lambda name: folder / f"{name}.pem"


def side(pem, name, **changes):
    """The certificates with which one side works, which trusts ours alone."""
    certificates = {"certificate": pem(name), "key": pem(f"{name}-key")}
    return {**certificates, "authority": pem("our-authority"), **changes}


@asynccontextmanager
async def listening(notes=None, **link):
    """A leader; yields its URL."""
    async with leader(notes, **link) as server:
        yield Link(**link).url(server.port)


async def stream_one(url, access, notes, timeout_s=5.0):
    """Connect, send a frame, and end."""
    async with follower(url, access=access, timeout_s=timeout_s) as client:
        client.send_frames(frames(0))
        await client.end("done")
    await until(lambda: notes.ends)


async def refusal(url, access):
    with pytest.raises(MmtError) as raised:
        await stream_one(url, access, LeaderNotes(), timeout_s=0.5)
    return str(raised.value)


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.write_text(f"{TOKEN}\n")
    return path


async def test_without_the_token_nobody_is_served_nor_told_anything(token_file, caplog):
    notes = LeaderNotes()
    async with listening(notes, token_file=token_file) as url:
        for offered in (None, "another token, as long", TOKEN[:-1], TOKEN + "x", "ü"):
            sentence = await refusal(url, Access(offered))
            assert "the token is missing or wrong: give the follower the leader's" in sentence
        with pytest.raises(MmtError, match="the token is missing"):  # before any other reason
            async with follower(url, channels=("force",)):
                pass
        assert notes.hellos == []
        async with (  # asked for after a break as well
            Wire(int(url.rpartition(":")[2])) as wire,
            follower(wire.port, access=Access(TOKEN)) as client,
        ):
            wire.cut()
            await until(lambda: not client.connected)
            await until(lambda: client.connected)
    assert len(notes.hellos) == 2
    assert TOKEN not in caplog.text
    assert TOKEN not in repr(Access(TOKEN))
    assert TOKEN not in Link(token_file=token_file).model_dump_json()


def test_the_environment_precedes_the_file(token_file):
    settings = Link(token_file=token_file)
    assert Access.from_settings(settings, {}).token == TOKEN
    assert Access.from_settings(settings, {TOKEN_VARIABLE: "x" * 16}).token == "x" * 16
    assert Access.from_settings(settings, {TOKEN_VARIABLE: ""}).token == TOKEN
    assert Access.from_settings(Link(), {}).token is None


def test_a_token_is_the_same_with_the_mark_and_line_ends_of_windows(tmp_path):
    (tmp_path / "token").write_text(f"{TOKEN}\r\n", "utf-8-sig")
    assert Access.from_settings(Link(token_file=tmp_path / "token"), {}).token == TOKEN
    assert Access.from_settings(Link(), {TOKEN_VARIABLE: f"{TOKEN}\r\n"}).token == TOKEN


def test_a_token_that_can_be_guessed_or_read_by_others_or_not_at_all_is_told_of(tmp_path, caplog):
    with pytest.raises(InputError, match=r"MMT_LINK_TOKEN has 15 characters, at least 16 .*rand"):
        Access.from_settings(Link(), {TOKEN_VARIABLE: "x" * 15})
    (tmp_path / "token").write_text("\n")
    with pytest.raises(InputError, match="token has 0 characters"):
        Access.from_settings(Link(token_file=tmp_path / "token"), {})
    with pytest.raises(InputError, match="nothing: No such file"):
        Access.from_settings(Link(token_file=tmp_path / "nothing"), {})
    (tmp_path / "token").write_text(TOKEN)
    for mode, warned in ((0o600, False), (0o644, True), (0o640, True)):
        (tmp_path / "token").chmod(mode)
        caplog.clear()
        assert Access.from_settings(Link(token_file=tmp_path / "token"), {}).token == TOKEN
        assert ("can be read by others" in caplog.text) is (warned and os.name == "posix")
        assert TOKEN not in caplog.text


@pytest.mark.parametrize(
    ("table", "settings"), [("link", Link), ("sharing", Sharing), ("listening", Listening)]
)
def test_what_is_wrong_with_certificates_names_the_table(table, settings):
    access = Access.from_settings(settings(authority=Path("lab.pem")), {}, table=table)
    with pytest.raises(InputError, match=rf"set certificate and key of \[{table}\]"):
        access.server_context()
    with pytest.raises(InputError, match=rf"\[{table}\] has certificates, give an https:// URL"):
        check_scheme("http://lab:8766", access)


async def test_the_errors_of_shared_models_name_their_own_tables():
    lab = Path("lab.pem")
    with pytest.raises(InputError, match=r"\[listening\] has certificates"):
        ListenerClient(Listening(authority=lab))
    server = SharingServer(Sharing(port=0, authority=lab), Relay(), {}, lambda *_: None)
    with pytest.raises(InputError, match=r"authority of \[sharing\]"):
        await server.start()


def test_a_token_is_a_text_and_in_a_header_a_bearers(token_file):
    access = Access.from_settings(Link(token_file=token_file), {})
    assert access.admits(TOKEN)
    for offered in (5, TOKEN.encode(), [TOKEN], {"token": TOKEN}, True, "\ud800"):
        assert not access.admits(offered), "a token of another type is none"
    assert access.admits_header(f"Bearer {TOKEN}")
    assert access.admits_header(f"bearer  {TOKEN} ")
    for header in (None, "", TOKEN, f"Basic {TOKEN}", "Bearer", "Bearer x", f"Bearer {TOKEN}x"):
        assert not access.admits_header(header)
    assert Access().admits_header(None)


@pytest.mark.parametrize("path", ["/network", "/nothing", "/socket.io", "/socket.io/../network"])
async def test_every_page_asks_for_the_token(token_file, path):
    async with (
        listening(token_file=token_file) as url,
        aiohttp.ClientSession() as session,
    ):
        for header in ({}, {"Authorization": "Bearer wrong"}):
            async with session.get(yarl.URL(url + path, encoded=True), headers=header) as answer:
                assert answer.status == 401
                assert answer.headers["WWW-Authenticate"] == "Bearer"
        good = {"Authorization": f"Bearer {TOKEN}"}
        async with session.get(yarl.URL(url + path, encoded=True), headers=good) as answer:
            assert answer.status == 404


FOREIGN = {"Host": "evil.example:80", "Origin": "http://evil.example:80"}
"""As a page sends whose name was pointed here (DNS rebinding)."""
HANDSHAKE = "/socket.io/?EIO=4&transport=websocket"


async def status(url, path, headers, method="GET"):
    async with (
        aiohttp.ClientSession() as session,
        session.request(method, url + path, headers=headers) as answer,
    ):
        return answer.status


@pytest.mark.parametrize("path", [HANDSHAKE, "/network", "/health", "/metrics", "/nothing"])
@pytest.mark.parametrize(
    "headers",
    [
        FOREIGN,
        {"Host": FOREIGN["Host"]},
        {"Origin": FOREIGN["Origin"]},
        {"Origin": "null"},
        {"Host": "127.0.0.1.evil.example"},
        {"Host": "["},
        {"Origin": "http://["},
    ],
)
async def test_pages_of_other_sites_reach_no_route(path, headers):
    async with listening() as url:
        for method in ("GET", "PUT"):
            assert await status(url, path, headers, method) == 403


async def test_the_own_machine_and_programs_where_everyone_may_connect_reach_the_routes(token_file):
    async with listening() as url:
        port = url.rpartition(":")[2]
        for host in ("localhost", f"localhost:{port}", f"127.0.0.1:{port}", "[::1]"):
            for headers in ({"Host": host}, {"Host": host, "Origin": f"http://{host}"}):
                assert await status(url, "/nothing", headers) == 404
            assert await status(url, "/network", {"Host": host}) == 404  # without the table
    named = {"Host": "leader.lab"}
    page = {**named, "Origin": "http://leader.lab"}
    async with listening(host="0.0.0.0", open=True) as everywhere:
        url = everywhere.replace("0.0.0.0", "127.0.0.1")
        assert await status(url, "/nothing", named) == 404
        assert await status(url, "/nothing", page) == 403
    good = {"Authorization": f"Bearer {TOKEN}"}
    async with listening(token_file=token_file) as url:
        assert await status(url, "/nothing", {**page, **good}) == 404


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.0.2.1"])
async def test_listening_for_strangers_must_be_allowed(host, pem):
    if host:
        server = LeaderServer(Link(host=host, port=0), CHANNELS, LeaderNotes().events())
        with pytest.raises(InputError, match=f"listening on {host} lets everyone"):
            await server.start()
        assert server.port == 0
    with pytest.raises(InputError, match=r"everyone who reaches port 1 .* or allow it by open = t"):
        check_listening(host, 1, Access(), FOLLOWERS, allowed=False)
    with pytest.raises(InputError, match="everyone"):  # encrypted, but for everyone
        check_listening(host, 1, Access(certificate=pem("our-leader")), FOLLOWERS, allowed=False)
    for own in ("127.0.0.1", "localhost", "127.8.8.8", "::1"):
        check_listening(own, 1, Access(), FOLLOWERS, allowed=False)
    check_listening(host, 1, Access(), FOLLOWERS, allowed=True)
    check_listening(host, 1, Access(TOKEN), FOLLOWERS, allowed=False)
    check_listening(host, 1, Access(authority=pem("our-authority")), FOLLOWERS, allowed=False)


async def test_both_sides_check_the_others_certificate(pem, token_file, caplog):
    ours, leads = side(pem, "our-follower"), side(pem, "our-leader")
    notes = LeaderNotes()
    async with listening(notes, **leads) as url, aiohttp.ClientSession() as session:
        assert url.startswith("https://127.0.0.1:")
        for wrong in ({**ours, "certificate": None, "key": None}, side(pem, "their-follower")):
            said = await refusal(url, Access(**wrong))
            assert re.search("do not trust each other|check this follower's certificate", said)
        with pytest.raises(aiohttp.ClientError):
            await session.get(url.replace("https", "http"))
        assert notes.hellos == []
        await stream_one(url, Access(**ours), notes)
    assert notes.sequences == [0]
    assert "Traceback" not in caplog.text
    async with listening(**side(pem, "their-leader", authority=None)) as url:
        sentence = await refusal(url, Access(**ours))
        assert "do not trust each other" in sentence
        assert "check certificate, key and authority of [link] on both" in sentence
    by_token = {**leads, "authority": None, "token_file": token_file}
    async with listening(notes, **by_token) as url:
        await stream_one(url, Access(TOKEN, authority=pem("our-authority")), notes)
        assert "token is missing" in await refusal(url, Access(authority=pem("our-authority")))


def test_certificate_files_that_do_not_fit_are_explained(pem, tmp_path):
    nothing, rubbish = tmp_path / "nothing.pem", tmp_path / "rubbish.pem"
    rubbish.write_text("rubbish")
    for changes, sentence in (
        ({"key": pem("their-follower-key")}, "key values mismatch; both must be PEM files"),
        ({"certificate": nothing}, "No such file"),
        ({"authority": rubbish}, "rubbish.pem: no certificate or crl found; it must be"),
        ({"authority": nothing}, "authority .*nothing.pem: No such file"),
    ):
        with pytest.raises(InputError, match=sentence):
            Access(**side(pem, "our-follower", **changes)).client_context()
    with pytest.raises(ValueError, match="belong together: give both or neither"):
        Link(certificate=pem("our-leader"))
    context = Access(**side(pem, "our-leader")).server_context()
    assert context.minimum_version >= ssl.TLSVersion.TLSv1_2
    assert context.verify_mode is ssl.CERT_REQUIRED
