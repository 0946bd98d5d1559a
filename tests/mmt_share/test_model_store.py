"""A store of models and its commands: what is added comes back whole, and nothing else gets in."""

import asyncio
import hashlib
import json
import socket
import threading
from asyncio import to_thread
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import numpy as np
import pytest
from command_runs import output_of, refusal, run_json
from sharing_samples import model_of, shared

from mmt.core.errors import InputError, MmtError
from mmt.core.requests import PROXY, AnswerError
from mmt.leader.part import Session
from mmt.link.access import Access
from mmt.scene import Scene
from mmt.texture.model.texture_model import TextureModel
from mmt_share.parts.sharing import SharingPart
from mmt_share.store import store as store_module
from mmt_share.store.client import RemoteStore
from mmt_share.store.store import Entry, ModelStore
from mmt_share.tables import Sharing

TOKEN = "0123456789abcdef0123"


def test_a_model_is_there_once_and_by_its_hash(tmp_path):
    store, data = ModelStore(tmp_path / "new" / "folder"), model_of(10).to_bytes()
    assert store.entries() == []
    entry = store.add(data, Entry("table", "ann", "CC0"))
    assert entry.hash == hashlib.sha256(data).hexdigest()
    assert (entry.samples, entry.order, entry.inputs) == (10, 6, "isotropic")
    assert store.add(data, Entry("another name")) == entry
    assert store.entries() == [entry]
    path = store.path(entry.hash)
    assert path.read_bytes() == data


def test_what_is_no_model_or_too_much_is_refused(tmp_path, monkeypatch):
    store = ModelStore(tmp_path)
    for data in (b"", b"PK nonsense", bytes(1000)):
        with pytest.raises(InputError):
            store.add(data, Entry("x"))
    with pytest.raises(InputError, match="bytes: "):
        store.add(bytes(store_module.LARGEST_BYTES + 1), Entry("x"))
    for digest in ("", "../../etc/passwd", "a" * 63, "A" * 64, "a" * 65):
        assert store.path(digest) is None
    for said in ({}, {"name": " "}, {"name": "x", "error_db": "much"}):
        with pytest.raises(InputError):
            Entry.from_description(said)
    monkeypatch.setattr(store_module, "MOST_MODELS", 1)
    store.add(model_of(10).to_bytes(), Entry("x"))
    with pytest.raises(InputError, match="takes no more"):
        store.add(model_of(11).to_bytes(), Entry("y"))


def test_what_is_damaged_is_left_out(tmp_path):
    store = ModelStore(tmp_path)
    entry = store.add(model_of(10).to_bytes(), Entry("table"))
    gone = json.dumps({"name": "gone", "hash": "d" * 64})
    texts = ("{", "[1]", '{"unknown": 1}', gone, "[" * 100_000)
    for name, text in zip("abcde", texts, strict=True):
        (tmp_path / f"{name * 64}.json").write_text(text)
    assert store.entries() == [entry]


async def test_an_error_is_a_finite_number_and_may_be_nought(tmp_path):
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        remote = RemoteStore(sharing.url, Access())
        exact, other = (model_of(samples).to_bytes() for samples in (12, 13))
        pushed = await asyncio.to_thread(remote.push, exact, Entry("exact", error_db=0.0))
        assert pushed.error_db == 0.0
        async with aiohttp.ClientSession() as http:
            for error in ("NaN", "Infinity", "-inf", "1" * 400, "[1]", "true"):
                address = f"{sharing.url}/models?name=other&error_db={error}"
                async with http.post(address, data=other) as answer:
                    assert (answer.status, "finite number" in await answer.text()) == (400, True)
        assert await asyncio.to_thread(remote.entries) == [pushed]


async def test_a_model_goes_there_and_comes_back(tmp_path):
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        remote = RemoteStore(sharing.url, Access())
        model = model_of(12)
        pushed = await asyncio.to_thread(
            remote.push, model.to_bytes(), Entry("table", "ann", "CC0", "oak", error_db=0.5)
        )
        assert await asyncio.to_thread(remote.entries) == [pushed]
        assert (pushed.who, pushed.licence, pushed.error_db) == ("ann", "CC0", 0.5)
        assert await asyncio.to_thread(remote.find, pushed.hash[:8]) == pushed
        target = tmp_path / "table.npz"
        await asyncio.to_thread(remote.fetch, pushed.hash, target)
        same = TextureModel.load(target)
        np.testing.assert_array_equal(same.samples.lsf, model.samples.lsf)
        with pytest.raises(InputError, match=r"no model called chair .* there are table"):
            await asyncio.to_thread(remote.find, "chair")
        assert Entry.from_description({"name": "\x1b" + 999 * "x"}).name.startswith("\ufffdx")
        with pytest.raises(MmtError, match="not a texture model"):
            await asyncio.to_thread(remote.push, b"nonsense", Entry("x"))


def full(folder, data):
    """Let a store's disk be full for this model; return what is said of it."""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    folder.mkdir()
    part = folder / f"{hashlib.sha256(data).hexdigest()}.npz.part"
    part.symlink_to("/dev/full")
    return "No space left on device"


def unwritable(folder, _):
    """Let a store's folder be one that cannot be made, by root neither; return what is said."""
    folder.write_text("a file")
    return "cannot write"


SPOILT = pytest.mark.parametrize("spoil", [full, unwritable])


@SPOILT
async def test_a_store_that_cannot_be_written_is_not_the_fault_of_who_pushes(tmp_path, spoil):
    folder, data = tmp_path / "store", model_of(12).to_bytes()
    said = spoil(folder, data)
    async with shared(store=str(folder), accept=True) as sharing:
        remote = RemoteStore(sharing.url, Access())
        with pytest.raises(AnswerError, match=f"it cannot be stored: .*{said}") as raised:
            await asyncio.to_thread(remote.push, data, Entry("table"))
        assert raised.value.status == 507
        assert await asyncio.to_thread(remote.entries) == []


@SPOILT
def test_a_store_that_cannot_be_written_is_told_at_the_end_of_a_run(tmp_path, spoil):
    folder, model = tmp_path / "store", model_of(12)
    reason = spoil(folder, model.to_bytes())
    said = []
    sharing = SimpleNamespace(newest=model, takes_over=True)
    SharingPart(Session(Scene(), said.append), Sharing(store=folder), sharing).close()
    (sentence,) = said
    assert sentence.startswith(f"the model is not in the store {folder}: ")
    assert reason in sentence


async def test_a_fetch_that_broke_off_goes_on(tmp_path):
    data = model_of(40).to_bytes()
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        remote = RemoteStore(sharing.url, Access())
        entry = await asyncio.to_thread(remote.push, data, Entry("table"))
        target = tmp_path / "table.npz"
        part = tmp_path / "table.npz.part"
        part.write_bytes(data[:1000])
        await asyncio.to_thread(remote.fetch, entry.hash, target)
        assert target.read_bytes() == data
        assert not part.exists()
        part.write_bytes(b"of another model" * 10)
        with pytest.raises(MmtError, match="is not model"):
            await asyncio.to_thread(remote.fetch, entry.hash, target)
        assert not part.exists()
        for begun in (b"", data + b"of a longer model"):
            part.write_bytes(begun)
            await asyncio.to_thread(remote.fetch, entry.hash, target)
            assert target.read_bytes() == data


class Server:
    """An HTTP server that gives one answer to all requests, and notes what they show."""

    def __init__(self, answer, endless=b""):
        self.shown = []
        self._answer, self._endless = answer, endless
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        with suppress(OSError):
            while True:
                connection, _ = self._socket.accept()
                with connection, suppress(OSError):
                    self.shown.append(connection.recv(65_536))
                    connection.sendall(self._answer)
                    while self._endless:
                        connection.sendall(self._endless)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()


EMPTY_LISTING = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n[]"


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_token_goes_to_nobody_but_whom_it_is_for(status, tmp_path):
    with Server(EMPTY_LISTING) as other:
        there = f"HTTP/1.1 {status} Go\r\nLocation: {other.url}/models\r\n\r\n"
        with Server(there.encode()) as server:
            remote = RemoteStore(server.url, Access(TOKEN))
            with pytest.raises(MmtError, match=f"go to {other.url}/models, which is not followed"):
                remote.entries()
            with pytest.raises(MmtError, match="which is not followed"):
                remote.fetch("a" * 64, tmp_path / "oak.npz")
            with pytest.raises(MmtError, match="which is not followed"):
                remote.push(b"", Entry("oak"))
            assert all(TOKEN.encode() in shown for shown in server.shown)
        assert other.shown == []


def test_a_proxy_of_the_environment_sees_no_token(monkeypatch):
    with Server(EMPTY_LISTING) as proxy, Server(EMPTY_LISTING) as server:
        for name in ("http_proxy", "https_proxy", "all_proxy"):
            monkeypatch.setenv(name, proxy.url)
        assert RemoteStore(server.url, Access(TOKEN)).entries() == []
        assert (len(server.shown), proxy.shown) == (1, [])
        for told in (False, True):  # the proxy is asked for a tunnel, and sees no more than that
            if told:
                monkeypatch.setenv(PROXY, proxy.url)
            with pytest.raises(MmtError, match="does not answer"):
                RemoteStore("https://127.0.0.1:1", Access(TOKEN)).entries()
            assert [b"CONNECT 127.0.0.1:1" in shown for shown in proxy.shown] == [True] * told
        assert not any(TOKEN.encode() in shown for shown in proxy.shown)


@pytest.mark.parametrize("head", [b"", b"Content-Length: 999999999999\r\n"])
def test_an_endless_listing_or_model_is_not_read_to_its_end(head, tmp_path):
    with Server(b"HTTP/1.1 200 OK\r\n" + head + b"\r\n[", b" " * 65_536) as server:
        remote = RemoteStore(server.url, Access())
        with pytest.raises(MmtError, match="sends more than it should"):
            remote.entries()
        with pytest.raises(MmtError, match="sends more than it should"):
            remote.fetch("a" * 64, tmp_path / "oak.npz")
        assert (tmp_path / "oak.npz.part").stat().st_size <= store_module.LARGEST_BYTES


ENTRY = {"name": "oak", "hash": "a" * 64, "samples": 10}


def test_a_listing_that_makes_no_sense_is_refused_and_any_other_can_be_printed(monkeypatch):
    said = []
    monkeypatch.setattr(RemoteStore, "_request", lambda *_, **__: said[-1])
    remote = RemoteStore("http://127.0.0.1:1", Access())
    said.append(json.dumps([{**ENTRY, "note": "\x1b[31m"}]).encode())
    printable = Entry("oak", note="\N{REPLACEMENT CHARACTER}[31m", hash="a" * 64, samples=10)
    assert remote.entries() == [printable]
    changes = {"hash": "../../oak"}, {"hash": ""}, {"name": []}, {"samples": "x"}, {"unknown": 1}
    wrong = [json.dumps([{**ENTRY, **change}]).encode() for change in changes]
    wrong += [b"{", b"[" * 100_000, b"7", b"[7]"]
    for listing in (*wrong, json.dumps([ENTRY] * (store_module.MOST_MODELS + 1)).encode()):
        said.append(listing)
        with pytest.raises(MmtError, match="has no store of models that this program reads"):
            remote.entries()
        with pytest.raises(MmtError, match="cannot be read"):
            remote.push(b"", Entry("oak"))


async def test_without_leave_nothing_is_added_and_without_a_store_nothing_is_there(tmp_path):
    async with shared(store=str(tmp_path / "store")) as sharing:
        remote = RemoteStore(sharing.url, Access())
        with pytest.raises(MmtError, match="it takes no models"):
            await asyncio.to_thread(remote.push, model_of(10).to_bytes(), Entry("x"))
    async with shared() as sharing:
        with pytest.raises(MmtError, match="Not Found"):
            await asyncio.to_thread(RemoteStore(sharing.url, Access()).entries)
        port = sharing.server.port
    with pytest.raises(MmtError, match="does not answer"):
        await asyncio.to_thread(RemoteStore(f"http://127.0.0.1:{port}", Access()).entries)


async def test_the_store_asks_for_the_token(tmp_path, monkeypatch):
    monkeypatch.setenv("MMT_SHARING_TOKEN", TOKEN)
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        for token in (None, "another0123456789abcd"):
            with pytest.raises(MmtError, match="give the leader's token"):
                await asyncio.to_thread(RemoteStore(sharing.url, Access(token)).entries)
        trusted = RemoteStore(sharing.url, Access(TOKEN))
        await asyncio.to_thread(trusted.push, model_of(10).to_bytes(), Entry("x"))
        assert len(await asyncio.to_thread(trusted.entries)) == 1


MODEL = Path("configs/models/plastic.npz").resolve()


PUSH, PULL, LIST = (("model", name) for name in ("push", "pull", "list"))


async def test_a_model_is_pushed_listed_and_pulled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        about = ("--name", "a/b", "--licence", "CC0")
        await to_thread(output_of, *PUSH, MODEL, "--to", sharing.url, *about)
        (entry,), _ = await to_thread(run_json, tmp_path, *LIST, "--from", sharing.url)
        assert (entry["name"], entry["licence"]) == ("a/b", "CC0")
        pull = (*PULL, "a/b", "--from", sharing.url)
        await to_thread(output_of, *pull)
        assert (tmp_path / "a-b.npz").read_bytes() == MODEL.read_bytes()
        assert "--force replaces it" in await to_thread(refusal, *pull)


def test_a_store_that_does_not_answer_is_named():
    nobody = refusal(*LIST, "--from", "http://127.0.0.1:9", kind=MmtError)
    assert "http://127.0.0.1:9 does not answer" in nobody
