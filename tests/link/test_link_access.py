"""Who may connect: tokens, certificates, and what is listened on without them."""

import logging
import os
import re
import ssl
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import pytest
import trustme
import yarl
from link_samples import CHANNELS, FollowerNotes, LeaderNotes, frames, hello, leader, until
from wire_relay import relay

from mmt.core.errors import InputError, MmtError
from mmt.link.access import FOLLOWERS, TOKEN_VARIABLE, Access, check_listening, check_scheme
from mmt.link.client import FollowerClient
from mmt.link.server import LeaderServer
from mmt.scene import Link
from mmt_share.client import ListenerClient
from mmt_share.relay import Relay
from mmt_share.server import SharingServer
from mmt_share.tables import Listening, Sharing

TOKEN = "a token that nobody guesses"


@dataclass(frozen=True)
class Files:
    """PEM files of an authority, and of a leader and a follower that it has signed."""

    authority: Path
    leader: Path
    leader_key: Path
    follower: Path
    follower_key: Path

    @classmethod
    def make(cls, directory):
        directory.mkdir()
        authority = trustme.CA()
        authority.cert_pem.write_to_path(directory / "authority.pem")
        for name in ("127.0.0.1", "follower"):
            issued = authority.issue_cert(name)
            issued.private_key_pem.write_to_path(directory / f"{name}-key.pem")
            for index, pem in enumerate(issued.cert_chain_pems):
                pem.write_to_path(directory / f"{name}.pem", append=index > 0)
        return cls(
            directory / "authority.pem",
            directory / "127.0.0.1.pem",
            directory / "127.0.0.1-key.pem",
            directory / "follower.pem",
            directory / "follower-key.pem",
        )

    def leads(self, **changes):
        """How the leader listens: TLS, and certificates from its followers."""
        values = {
            "port": 0,
            "certificate": self.leader,
            "key": self.leader_key,
            "authority": self.authority,
        }
        return Link.model_validate({**values, **changes})

    def follows(self, **changes):
        values = {
            "certificate": self.follower,
            "key": self.follower_key,
            "authority": self.authority,
        }
        return Access(**{**values, **changes})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return Files.make(tmp_path_factory.mktemp("certificates") / "ours")


@pytest.fixture(scope="module")
def strangers(tmp_path_factory):
    return Files.make(tmp_path_factory.mktemp("certificates") / "theirs")


@asynccontextmanager
async def listening(settings, notes=None):
    """A leader; yields its URL."""
    server = LeaderServer(settings, CHANNELS, (notes or LeaderNotes()).events())
    await server.start()
    try:
        yield settings.url(server.port)
    finally:
        await server.stop()


async def stream_one(url, access, notes, timeout_s=5.0):
    """Connect, send a frame, and end."""
    client = FollowerClient(url, hello(), FollowerNotes().events(), access=access)
    try:
        await client.connect(timeout_s)
        client.send_frames(frames(0))
        await client.end("done")
    finally:
        await client.disconnect()
    await until(lambda: notes.ends)


async def refusal(url, access):
    with pytest.raises(MmtError) as raised:
        await stream_one(url, access, LeaderNotes(), timeout_s=0.5)
    return str(raised.value)


# --- the token


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.write_text(f"{TOKEN}\n")
    return path


async def test_a_follower_with_the_token_is_served(token_file):
    notes = LeaderNotes()
    settings = Link(port=0, token_file=token_file)
    async with listening(settings, notes) as url:
        await stream_one(url, Access.from_settings(settings), notes)
    assert notes.sequences == [0]


@pytest.mark.parametrize("offered", [None, "another token, as long", TOKEN[:-1], TOKEN + "x", "ü"])
async def test_without_the_token_nobody_is_served_nor_told_anything(token_file, offered, caplog):
    notes = LeaderNotes()
    async with listening(Link(port=0, token_file=token_file), notes) as url:
        sentence = await refusal(url, Access(offered))
        assert "refused: the token is missing or wrong: give the follower the leader's" in sentence
        other = FollowerClient(url, hello(channels=("force",)), FollowerNotes().events())
        with pytest.raises(MmtError, match="the token is missing"):  # before any other reason
            await other.connect(5.0)
        await other.disconnect()
    assert notes.hellos == []
    assert TOKEN not in caplog.text


@pytest.mark.parametrize("offered", [5, TOKEN.encode(), [TOKEN], {"token": TOKEN}, True, "\ud800"])
async def test_a_token_of_another_type_is_none(token_file, offered):
    access = Access.from_settings(Link(token_file=token_file))
    assert access.admits(TOKEN)
    assert not access.admits(offered)


async def test_a_token_that_nobody_asks_for_is_no_reason_to_refuse():
    notes = LeaderNotes()
    async with listening(Link(port=0), notes) as url:
        await stream_one(url, Access(TOKEN), notes)


async def test_the_token_is_asked_for_again_after_a_break(token_file):
    async with (
        leader(token_file=token_file) as server,
        relay(server.port) as wire,
    ):
        url = f"http://127.0.0.1:{wire.port}"
        follower = FollowerClient(url, hello(), FollowerNotes().events(), access=Access(TOKEN))
        await follower.connect(5.0)
        wire.drop()
        await until(lambda: not follower.connected)
        await until(lambda: follower.connected)
        await follower.disconnect()


def test_the_environment_precedes_the_file(token_file):
    settings = Link(token_file=token_file)
    assert Access.from_settings(settings, {}).token == TOKEN
    assert Access.from_settings(settings, {TOKEN_VARIABLE: "x" * 16}).token == "x" * 16
    assert Access.from_settings(settings, {TOKEN_VARIABLE: ""}).token == TOKEN
    assert Access.from_settings(Link(), {}).token is None


def test_a_token_that_can_be_guessed_or_not_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"MMT_LINK_TOKEN has 15 characters, at least 16 .*rand"):
        Access.from_settings(Link(), {TOKEN_VARIABLE: "x" * 15})
    (tmp_path / "token").write_text("\n")
    with pytest.raises(InputError, match="token has 0 characters"):
        Access.from_settings(Link(token_file=tmp_path / "token"), {})
    with pytest.raises(InputError, match="nothing: No such file"):
        Access.from_settings(Link(token_file=tmp_path / "nothing"), {})


@pytest.mark.parametrize(
    ("table", "settings"), [("link", Link), ("sharing", Sharing), ("listening", Listening)]
)
def test_what_is_wrong_with_certificates_names_the_table(table, settings):
    access = Access.from_settings(settings(authority=Path("lab.pem")), {}, table=table)
    with pytest.raises(InputError, match=rf"set certificate and key of \[{table}\]"):
        access.server_context()
    with pytest.raises(InputError, match=rf"\[{table}\] has certificates, give an https:// URL"):
        check_scheme("http://lab:8766", access)


def test_a_shared_models_errors_name_its_own_tables():
    lab = Path("lab.pem")
    with pytest.raises(InputError, match=r"\[listening\] has certificates"):
        ListenerClient(Listening(authority=lab))


async def test_a_server_of_a_shared_model_names_its_own_table():
    server = SharingServer(Sharing(port=0, authority=Path("lab.pem")), Relay(), {}, lambda *_: None)
    with pytest.raises(InputError, match=r"authority of \[sharing\]"):
        await server.start()


def test_the_token_is_neither_shown_nor_dumped(token_file):
    assert TOKEN not in repr(Access(TOKEN))
    assert TOKEN not in Link(token_file=token_file).model_dump_json()


def test_bearer_tokens(token_file):
    access = Access(TOKEN)
    assert access.admits_header(f"Bearer {TOKEN}")
    assert access.admits_header(f"bearer  {TOKEN} ")
    for header in (None, "", TOKEN, f"Basic {TOKEN}", "Bearer", "Bearer x", f"Bearer {TOKEN}x"):
        assert not access.admits_header(header)
    assert Access().admits_header(None)


@pytest.mark.parametrize("path", ["/network", "/nothing", "/socket.io", "/socket.io/../network"])
async def test_every_page_asks_for_the_token(token_file, path):
    async with (
        listening(Link(port=0, token_file=token_file)) as url,
        aiohttp.ClientSession() as session,
    ):
        for header in ({}, {"Authorization": "Bearer wrong"}):
            async with session.get(yarl.URL(url + path, encoded=True), headers=header) as answer:
                assert answer.status == 401
                assert answer.headers["WWW-Authenticate"] == "Bearer"
        good = {"Authorization": f"Bearer {TOKEN}"}
        async with session.get(yarl.URL(url + path, encoded=True), headers=good) as answer:
            assert answer.status == 404


# --- pages of other sites in a browser of the same machine

OWN = Link(port=0)
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
    ],
)
async def test_pages_of_other_sites_reach_no_route(path, headers):
    async with listening(OWN) as url:
        for method in ("GET", "PUT"):
            assert await status(url, path, headers, method) == 403


async def test_the_own_machine_reaches_every_route():
    async with listening(OWN) as url:
        port = url.rpartition(":")[2]
        for host in ("localhost", f"localhost:{port}", f"127.0.0.1:{port}", "[::1]"):
            assert await status(url, "/nothing", {"Host": host}) == 404
            headers = {"Host": host, "Origin": f"http://{host}"}
            assert await status(url, "/nothing", headers) == 404


async def test_programs_may_use_any_name_where_everyone_may_connect(token_file):
    named = {"Host": "leader.lab"}
    page = {**named, "Origin": "http://leader.lab"}
    async with listening(Link(host="0.0.0.0", port=0, open=True)) as everywhere:
        url = everywhere.replace("0.0.0.0", "127.0.0.1")
        assert await status(url, "/nothing", named) == 404
        assert await status(url, "/nothing", page) == 403
    good = {"Authorization": f"Bearer {TOKEN}"}
    async with listening(Link(port=0, token_file=token_file)) as url:
        assert await status(url, "/nothing", {**page, **good}) == 404


# --- what is listened on


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "127.8.8.8", "::1"])
def test_the_own_machine_needs_no_permission(host):
    check_listening(host, 1, Access(), FOLLOWERS, allowed=False)


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.0.2.1"])
def test_listening_for_strangers_must_be_allowed(host, files):
    with pytest.raises(InputError, match=r"everyone who reaches port 1 .* or allow it by open = t"):
        check_listening(host, 1, Access(), FOLLOWERS, allowed=False)
    with pytest.raises(InputError, match="everyone"):  # encrypted, but for everyone
        check_listening(host, 1, Access(certificate=files.leader), FOLLOWERS, allowed=False)
    check_listening(host, 1, Access(), FOLLOWERS, allowed=True)
    check_listening(host, 1, Access(TOKEN), FOLLOWERS, allowed=False)
    check_listening(host, 1, Access(authority=files.authority), FOLLOWERS, allowed=False)


async def test_a_leader_does_not_listen_for_strangers(monkeypatch):
    server = LeaderServer(Link(host="0.0.0.0", port=0), CHANNELS, LeaderNotes().events())
    with pytest.raises(InputError, match=r"listening on 0\.0\.0\.0 lets everyone"):
        await server.start()
    assert server.port == 0
    monkeypatch.setenv(TOKEN_VARIABLE, TOKEN)
    async with listening(Link(host="0.0.0.0", port=0)):
        pass


# --- TLS


async def test_certificates_on_both_sides(files):
    notes = LeaderNotes()
    async with listening(files.leads(), notes) as url:
        assert url.startswith("https://127.0.0.1:")
        await stream_one(url, files.follows(), notes)
    assert notes.sequences == [0]


async def test_tls_with_a_token_needs_no_certificate_of_the_follower(files, token_file):
    notes = LeaderNotes()
    settings = files.leads(authority=None, token_file=token_file)
    async with listening(settings, notes) as url:
        await stream_one(url, Access(TOKEN, authority=files.authority), notes)
        assert "token is missing" in await refusal(url, Access(authority=files.authority))


async def test_a_follower_without_the_right_certificate_is_refused(files, strangers):
    notes = LeaderNotes()
    async with listening(files.leads(), notes) as url:
        for access in (
            files.follows(certificate=None, key=None),
            files.follows(certificate=strangers.follower, key=strangers.follower_key),
        ):
            assert re.search(
                "do not trust each other|check this follower's certificate",
                await refusal(url, access),
            )
    assert notes.hellos == []


async def test_a_leader_that_is_not_the_one_is_refused(files, strangers):
    async with listening(strangers.leads(authority=None)) as url:
        sentence = await refusal(url, files.follows())
        assert "do not trust each other" in sentence
        assert "check certificate, key and authority of [link] on both" in sentence


async def test_plain_text_gets_nowhere(files):
    async with listening(files.leads()) as url, aiohttp.ClientSession() as session:
        plain, notes = url.replace("https", "http"), FollowerNotes()
        with pytest.raises(InputError, match="has certificates, give an https:// URL"):
            FollowerClient(plain, hello(), notes.events(), access=files.follows())
        with pytest.raises(aiohttp.ClientError):
            await session.get(plain)


async def test_https_to_a_leader_without_tls_is_explained():
    async with listening(Link(port=0)) as url:
        client = FollowerClient(url.replace("http", "https"), hello(), FollowerNotes().events())
        with pytest.raises(MmtError, match=r"no leader answered .* start mmt-leader there"):
            await client.connect(0.3)
        await client.disconnect()


def test_certificate_files_that_do_not_fit_are_explained(files, strangers, tmp_path):
    nothing, rubbish = tmp_path / "nothing.pem", tmp_path / "rubbish.pem"
    rubbish.write_text("rubbish")
    for access, sentence in (
        (files.follows(key=strangers.follower_key), "key values mismatch; both must be PEM files"),
        (files.follows(certificate=nothing), "No such file"),
        (files.follows(authority=rubbish), "rubbish.pem: no certificate or crl found; it must be"),
        (files.follows(authority=nothing), "authority .*nothing.pem: No such file"),
    ):
        with pytest.raises(InputError, match=sentence):
            access.client_context()
    with pytest.raises(InputError, match=r"needs its own: set certificate and key of \[link\]"):
        Access(authority=files.authority).server_context()
    with pytest.raises(ValueError, match="belong together: give both or neither"):
        Link(certificate=files.leader)


def test_old_tls_is_not_spoken(files):
    context = Access(None, files.leader, files.leader_key, files.authority).server_context()
    assert context.minimum_version >= ssl.TLSVersion.TLSv1_2
    assert context.verify_mode is ssl.CERT_REQUIRED


async def test_a_handshake_that_fails_leaves_the_leader_alone(files, strangers, caplog):
    notes = LeaderNotes()
    with caplog.at_level(logging.WARNING):
        async with listening(files.leads(), notes) as url:
            await refusal(url, strangers.follows(authority=files.authority))
            await stream_one(url, files.follows(), notes)
    assert "Traceback" not in caplog.text


@pytest.mark.skipif(os.name != "posix", reason="files have other rights")
@pytest.mark.parametrize(("mode", "warned"), [(0o600, False), (0o644, True), (0o640, True)])
def test_a_token_file_that_others_can_read_is_told_of(tmp_path, caplog, mode, warned):
    file = tmp_path / "token"
    file.write_text(TOKEN)
    file.chmod(mode)
    assert Access.from_settings(Link(token_file=file), environment={}).token == TOKEN
    assert ("can be read by others" in caplog.text) is warned
    assert TOKEN not in caplog.text
