"""Models from and to a store on another machine."""

import hashlib
import json
import ssl
import urllib.error
import urllib.parse
import urllib.request
from http import HTTPStatus
from http.client import HTTPException
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.core.printable import printable
from mmt.link.access import Access, check_scheme
from mmt.link.connection import check_url
from mmt.scene.sharing_tables import Listening
from mmt.sharing.messages import TOKEN_VARIABLE
from mmt.sharing.store import Entry

_TIMEOUT_S: Final = 20.0
_CHUNK: Final = 65_536


class RemoteStore:
    """The store of a leader.

    Parameters
    ----------
    url
        Where the leader shares, ``http://HOST:PORT`` or ``https://HOST:PORT``.
    access
        The token and the certificates of this side.

    Raises
    ------
    InputError
        The URL is not valid, or a certificate cannot be used.
    """

    def __init__(self, url: str, access: Access) -> None:
        check_url(url)
        check_scheme(url, access)
        self._url = url.rstrip("/")
        self._token = access.token
        self._tls = access.client_context()

    @classmethod
    def from_environment(cls, url: str) -> "RemoteStore":
        """Return the store, with the token that the environment has for shared models.

        Raises
        ------
        InputError
            The URL is not valid, or the token is too short.
        """
        return cls(url, Access.of(Listening(), variable=TOKEN_VARIABLE, table="listening"))

    def entries(self) -> list[Entry]:
        """Return what is known of all its models, the newest first.

        Raises
        ------
        MmtError
            It does not answer, or has no store.
        """
        try:
            return _entries(self._request("/models"))
        except InputError as error:
            raise MmtError(f"{self._url} has no store of models that this program reads") from error

    def find(self, name: str) -> Entry:
        """Return the newest model of a name, or that of a hash or its beginning.

        Raises
        ------
        InputError
            There is none.
        MmtError
            The store does not answer.
        """
        entries = self.entries()
        for entry in entries:
            if entry.name == name or (len(name) >= 6 and entry.hash.startswith(name)):
                return entry
        names = ", ".join(sorted({entry.name for entry in entries})) or "none"
        raise InputError(f"no model called {name} is at {self._url}; there are {names}")

    def fetch(self, digest: str, target: Path) -> None:
        """Fetch a model into a file; what an earlier attempt has left (``.part``) is gone on with.

        Raises
        ------
        MmtError
            The store does not answer or breaks off, or what came is not the model.
        InputError
            The file cannot be written.
        """
        part = target.with_name(f"{target.name}.part")
        try:
            begun = part.stat().st_size if part.is_file() else 0
            with self._open(f"/models/{digest}", begun=begun) as answer:
                goes_on = answer.status == HTTPStatus.PARTIAL_CONTENT
                with part.open("ab" if goes_on else "wb") as file:
                    while chunk := _read(answer, self._url):
                        file.write(chunk)
            if hashlib.sha256(part.read_bytes()).hexdigest() != digest:
                part.unlink()
                raise MmtError(f"what came from {self._url} is not model {digest[:12]}: try again")
            part.replace(target)
        except OSError as error:
            raise InputError(f"model {target}: {error.strerror or error}") from error

    def push(self, data: bytes, said: Entry) -> Entry:
        """Add a model; return what the store says of it. One that is there already stays.

        Raises
        ------
        MmtError
            The store does not answer, or does not take it; the message says why.
        """
        about = {key: value for key, value in said.as_dict().items() if value not in {"", 0, None}}
        answer = self._request(f"/models?{urllib.parse.urlencode(about)}", data=data)
        try:
            return Entry.listed(json.loads(answer))
        except (ValueError, RecursionError, InputError) as error:
            raise MmtError(f"what {self._url} says of the model cannot be read") from error

    def _request(self, path: str, *, data: bytes | None = None) -> bytes:
        with self._open(path, data=data) as answer:
            parts = []
            while chunk := _read(answer, self._url):
                parts.append(chunk)
            return b"".join(parts)

    def _open(self, path: str, *, data: bytes | None = None, begun: int = 0) -> Any:
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        if begun:
            headers["Range"] = f"bytes={begun}-"
        request = urllib.request.Request(self._url + path, data=data, headers=headers)  # noqa: S310
        context = self._tls or ssl.create_default_context()
        try:
            return urllib.request.urlopen(  # noqa: S310 - the scheme is checked
                request, timeout=_TIMEOUT_S, context=context
            )
        except urllib.error.HTTPError as error:
            if begun and error.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                error.close()  # what was begun is not shorter than the model: it is of another
                return self._open(path)
            with error:
                said = error.read(1024).decode(errors="replace").strip().partition("\n")[0]
            raise MmtError(f"{self._url} answers: {printable(said or error.reason)}") from error
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise MmtError(f"no store answers at {self._url} ({reason})") from error


def _entries(text: str | bytes) -> list[Entry]:
    """Return a store's entries out of its listing.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        listed = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a list of models is not valid JSON: {error}") from error
    if not isinstance(listed, list):
        raise InputError("a list of models is no list")
    return [Entry.listed(each) for each in listed]


def _read(answer: Any, url: str) -> bytes:
    try:
        return bytes(answer.read(_CHUNK))
    except (OSError, HTTPException) as error:
        raise MmtError(f"{url} broke off: the same command goes on from there") from error
