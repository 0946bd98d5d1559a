"""Models from and to a store on another machine."""

import hashlib
import urllib.parse
from contextlib import AbstractContextManager, suppress
from http import HTTPStatus
from pathlib import Path
from typing import Final

from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import write_error
from mmt.core.files.untrusted import parsed_json
from mmt.core.requests import Answer, AnswerError, open_answer
from mmt.link.access import Access, check_scheme
from mmt.link.connection import check_url
from mmt_share.store.store import LARGEST_BYTES, MOST_MODELS, Entry

_LARGEST_ENTRY: Final = 10_000
"""Most bytes of one listed entry."""


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

    def entries(self) -> list[Entry]:
        """Return the entries of all models, the newest first.

        Raises
        ------
        MmtError
            The leader does not answer, or has no store.
        """
        text = self._request("/models", MOST_MODELS * _LARGEST_ENTRY)
        with suppress(InputError):
            listed = parsed_json(text, "the list")
            if isinstance(listed, list) and len(listed) <= MOST_MODELS:
                return [Entry.from_message(each) for each in listed]
        raise MmtError(f"{self._url} has no store of models that this program reads")

    def find(self, name: str) -> Entry:
        """Return the newest model with this name, or with a hash that begins so (6 digits or more).

        Raises
        ------
        InputError
            There is no such model.
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
        """Fetch a model into a file; resume an earlier attempt that has left a ``.part`` file.

        Raises
        ------
        MmtError
            The store does not answer or breaks off, or the received file is not the model.
        InputError
            The file cannot be written.
        """
        part = target.with_name(f"{target.name}.part")
        try:
            try:
                self._fetch_rest(digest, part)
            except AnswerError as error:
                if error.status != HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                    raise
                part.unlink()  # not shorter than the model: it is part of another one
                self._fetch_rest(digest, part)
            if hashlib.sha256(part.read_bytes()).hexdigest() != digest:
                part.unlink()
                raise MmtError(f"what came from {self._url} is not model {digest[:12]}: try again")
            part.replace(target)
        except OSError as error:
            raise write_error(target, error) from error

    def _fetch_rest(self, digest: str, part: Path) -> None:
        begun = part.stat().st_size if part.is_file() else 0
        with self._open(f"/models/{digest}", begun=begun) as answer:
            goes_on = answer.status == HTTPStatus.PARTIAL_CONTENT
            with part.open("ab" if goes_on else "wb") as file:
                for chunk in answer.chunks(LARGEST_BYTES - (begun if goes_on else 0)):
                    file.write(chunk)

    def push(self, data: bytes, description: Entry) -> Entry:
        """Add a model and return its entry in the store; a model that is there already stays.

        Raises
        ------
        MmtError
            The store does not answer, or does not accept the model; the message says why.
        """
        given = vars(description).items()
        about = {k: v for k, v in given if v or (k == "error_db" and v is not None)}
        path = f"/models?{urllib.parse.urlencode(about)}"
        answer = self._request(path, _LARGEST_ENTRY, data=data)
        try:
            return Entry.from_message(parsed_json(answer, "the answer"))
        except InputError as error:
            raise MmtError(f"what {self._url} says of the model cannot be read") from error

    def _request(self, path: str, most_bytes: int, *, data: bytes | None = None) -> bytes:
        with self._open(path, data=data) as answer:
            return answer.content(most_bytes)

    def _open(
        self, path: str, *, data: bytes | None = None, begun: int = 0
    ) -> AbstractContextManager[Answer]:
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        if begun:
            headers["Range"] = f"bytes={begun}-"
        return open_answer(self._url, path, data=data, headers=headers, tls=self._tls)
