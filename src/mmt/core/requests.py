"""HTTP requests to untrusted servers: direct, bounded, and never redirected.

Redirects are not followed, and the usual proxy variables of the environment are ignored, so that a
token reaches no other server. `PROXY` names a proxy for ``https`` requests, which it cannot read;
``http`` requests go directly to the server, as the link between the services does.
"""

import os
import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPException, HTTPResponse
from typing import Any, Final

from mmt.core.errors import MmtError, printable

PROXY: Final = "MMT_HTTPS_PROXY"
"""The environment variable with the address of a proxy, ``http://HOST:PORT``."""
TIMEOUT_S: Final = 20.0
"""Longest time without data from a server."""
_LONGEST_S: Final = 300.0
"""Longest time for one answer."""
_CHUNK: Final = 65_536
_MOST_SAID: Final = 1024


class AnswerError(MmtError):
    """A server refuses a request, or redirects it.

    Attributes
    ----------
    status
        HTTP status.
    reply
        First line of the answer, or the status in words; printable.
    """

    def __init__(self, url: str, status: int, reply: str) -> None:
        super().__init__(f"{url} answers: {reply}")
        self.status, self.reply = status, reply


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Treats a redirect as an error."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        """Make no further request."""


class Answer:
    """A server's answer, with its content not yet read."""

    def __init__(self, url: str, response: HTTPResponse) -> None:
        self._url, self._response = url, response
        self.status = response.status

    def chunks(self, most_bytes: int) -> Iterator[bytes]:
        """Yield the content.

        Raises
        ------
        MmtError
            The server breaks off, takes too long, or sends more than `most_bytes`.
        """
        until_s = time.monotonic() + _LONGEST_S
        while True:
            try:
                chunk = self._response.read1(_CHUNK)
            except (OSError, ValueError, HTTPException) as error:
                raise MmtError(f"{self._url} broke off: try again") from error
            most_bytes -= len(chunk)
            if most_bytes < 0:
                raise MmtError(f"{self._url} sends more than it should: it was not read to its end")
            if time.monotonic() > until_s:
                raise MmtError(f"{self._url} took longer than {_LONGEST_S:g} s to send: try again")
            if not chunk:
                break
            yield chunk
        if self._response.length:
            raise MmtError(f"{self._url} broke off: try again")

    def content(self, most_bytes: int) -> bytes:
        """Return the content; see `chunks`."""
        return b"".join(self.chunks(most_bytes))


@contextmanager
def open_answer(
    server: str,
    path: str,
    *,
    data: bytes | None = None,
    headers: Mapping[str, str] | None = None,
    tls: ssl.SSLContext | None = None,
    timeout_s: float = TIMEOUT_S,
) -> Iterator[Answer]:
    """Send a GET, or a POST with `data`; the answer can be read during the block.

    Parameters
    ----------
    server, path
        ``http://HOST:PORT`` or ``https://HOST:PORT``, which errors name, and the path on it.
    data
        Content of a POST, None for a GET.
    headers
        Further headers, such as ``Authorization``.
    tls
        TLS context; None for the system's certificate authorities.
    timeout_s
        Longest time without data from the server.

    Raises
    ------
    AnswerError
        The server refuses, or redirects.
    MmtError
        The server does not answer.
    """
    proxy = os.environ.get(PROXY)
    proxies = {"https": proxy} if proxy else {}
    handlers: list[urllib.request.BaseHandler] = [
        _NoRedirect(),
        urllib.request.ProxyHandler(proxies),
    ]
    if server.startswith("https:"):
        context = tls or ssl.create_default_context()
        handlers.append(urllib.request.HTTPSHandler(context=context))
    opener = urllib.request.build_opener(*handlers)
    try:
        asked = urllib.request.Request(server + path, data=data, headers=dict(headers or {}))  # noqa: S310 - the scheme is checked
        response = opener.open(asked, timeout=timeout_s)
    except urllib.error.HTTPError as error:
        raise AnswerError(server, error.code, _first_line(error)) from error
    except (OSError, ValueError, HTTPException) as error:
        raise MmtError(f"{server} does not answer ({getattr(error, 'reason', error)})") from error
    with response:
        yield Answer(server, response)


def _first_line(error: urllib.error.HTTPError) -> str:
    """Return the first line of a refusal."""
    with error:
        if error.code in range(300, 400):
            other = printable(str(error.headers.get("Location"))[:_MOST_SAID])
            return f"go to {other}, which is not followed: give that address if you trust it"
        try:
            line = error.read(_MOST_SAID).decode(errors="replace").strip().partition("\n")[0]
        except (OSError, HTTPException):
            line = ""
        return printable(line or str(error.reason))
