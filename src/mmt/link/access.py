"""Who may connect: a shared token, TLS, and the addresses to listen on without them.

The token never becomes part of the scene, which is written into recordings, reports and logs;
it comes from the environment or from a file of its own.
"""

import hmac
import ipaddress
import logging
import os
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from mmt.core.errors import InputError
from mmt.scene.table import SecuredTable

LOG: Final = logging.getLogger("mmt.link")

TOKEN_VARIABLE: Final = "MMT_LINK_TOKEN"  # noqa: S105 - the variable's name
SHORTEST_TOKEN: Final = 16
"""Least characters; so many random hexadecimal digits cannot be guessed over a network."""

REFUSED: Final = (
    "the token is missing or wrong: give the follower the leader's token, "
    f"in {TOKEN_VARIABLE} or token_file of [link]"
)

_LONGEST_FILE: Final = 4096


@dataclass(frozen=True)
class Access:
    """Credentials that one side presents to the other and requires of it; none by default.

    Parameters
    ----------
    token
        Shared secret; None requires none.
    certificate, key
        PEM files of this side's certificate, with its chain, and of its private key.
    authority
        PEM file of the authority that has signed the other side's certificate. A leader that
        has one accepts only followers with such a certificate.
    table
        Name of the scene's table with these settings, for errors.
    """

    token: str | None = field(default=None, repr=False)
    certificate: Path | None = None
    key: Path | None = None
    authority: Path | None = None
    table: str = "link"

    @classmethod
    def from_settings(
        cls,
        settings: SecuredTable,
        environment: Mapping[str, str] = os.environ,
        variable: str = TOKEN_VARIABLE,
        table: str = "link",
    ) -> "Access":
        """Return the access from a scene's table, named `table`, and an environment variable.

        Raises
        ------
        InputError
            The token is too short, or its file cannot be read.
        """
        token = environment.get(variable, "").strip() or None
        origin = variable
        if token is None and settings.token_file is not None:
            token, origin = _read_token(settings.token_file), f"the file {settings.token_file}"
        if token is not None and len(token) < SHORTEST_TOKEN:
            raise InputError(
                f"the token in {origin} has {len(token)} characters, at least {SHORTEST_TOKEN} "
                "are needed: make one by `openssl rand -hex 32`"
            )
        return cls(token, settings.certificate, settings.key, settings.authority, table)

    def admits(self, offered: object) -> bool:
        """Return whether this is the token, in constant time; without a token always true."""
        if self.token is None:
            return True
        text = offered if isinstance(offered, str) else ""
        return hmac.compare_digest(_bytes(text), _bytes(self.token))

    def admits_header(self, authorization: str | None) -> bool:
        """Return whether a request's ``Authorization`` header has the token, as ``Bearer``."""
        scheme, _, offered = (authorization or "").partition(" ")
        return self.admits(offered.strip() if scheme.lower() == "bearer" else None)

    @property
    def authenticates_peer(self) -> bool:
        """Whether a leader requires a token or a certificate."""
        return self.token is not None or self.authority is not None

    def server_context(self) -> ssl.SSLContext | None:
        """Return the TLS context of the side that listens, or None without TLS.

        Raises
        ------
        InputError
            A file cannot be used, or there is an authority but no certificate.
        """
        if self.certificate is None:
            if self.authority is not None:
                raise InputError(
                    f"who asks the other side for a certificate (authority of [{self.table}]) "
                    f"needs its own: set certificate and key of [{self.table}]"
                )
            return None
        context = _at_least_tls_1_2(ssl.create_default_context(ssl.Purpose.CLIENT_AUTH))
        self._load(context)
        if self.authority is not None:
            context.verify_mode = ssl.CERT_REQUIRED
        return context

    def client_context(self) -> ssl.SSLContext | None:
        """Return the follower's TLS context, or None if the system's authorities are enough.

        Raises
        ------
        InputError
            A file cannot be used.
        """
        if self.certificate is None and self.authority is None:
            return None
        context = _at_least_tls_1_2(ssl.create_default_context(ssl.Purpose.SERVER_AUTH))
        self._load(context)
        return context

    def _load(self, context: ssl.SSLContext) -> None:
        if self.certificate is not None:
            try:  # the empty password keeps the library from asking the terminal for one
                context.load_cert_chain(self.certificate, self.key, password="")
            except (OSError, ValueError) as error:
                raise InputError(
                    f"certificate {self.certificate} with key {self.key}: {_why(error)}; both "
                    "must be PEM files that belong together, the key without a password"
                ) from error
        if self.authority is not None:
            try:
                context.load_verify_locations(self.authority)
            except OSError as error:
                raise InputError(
                    f"authority {self.authority}: {_why(error)}; it must be a PEM file"
                ) from error


@dataclass(frozen=True)
class Entrance:
    """Who connects to a port, and which settings its error messages name.

    Parameters
    ----------
    role
        What a client acts as.
    address
        Names of the settings of host and port.
    remedy
        What to do so that clients on other machines may connect.
    """

    role: str
    address: str
    remedy: str

    @classmethod
    def of_table(cls, role: str, table: str, variable: str) -> Self:
        """Return the entrance configured by a scene's table and an environment variable."""
        return cls(
            role,
            f"host and port of [{table}]",
            f"set a token ({variable}, or token_file of [{table}]), or certificates (certificate, "
            f"key and authority of [{table}]), or allow it by open = true of [{table}]",
        )


FOLLOWERS: Final = Entrance.of_table("the follower", "link", TOKEN_VARIABLE)


def check_listening(
    host: str, port: int, access: Access, entrance: Entrance, *, allowed: bool
) -> None:
    """Refuse to listen on an address to which anyone can connect, unless that is allowed.

    Parameters
    ----------
    host, port
        Where to listen.
    access
        What clients must present.
    entrance
        Role and settings that the error names.
    allowed
        Whether clients without a token or certificate may connect.

    Raises
    ------
    InputError
        `host` is not loopback, and neither a token nor certificates are required.
    """
    if allowed or access.authenticates_peer or is_loopback(host):
        return
    raise InputError(
        f"listening on {host or 'all addresses'} lets everyone who reaches port {port} be "
        f"{entrance.role}: {entrance.remedy}"
    )


def check_scheme(url: str, access: Access) -> None:
    """Refuse a URL without TLS if the scene has certificates.

    Raises
    ------
    InputError
        The URL has no TLS.
    """
    wanted = access.certificate is not None or access.authority is not None
    if wanted and not url.startswith(("https:", "wss:")):
        raise InputError(
            f"leader's URL {url!r}: [{access.table}] has certificates, give an https:// URL"
        )


def _read_token(path: Path) -> str:
    try:
        with path.open(encoding="utf-8-sig") as stream:  # with the mark that Windows writes
            if os.name == "posix" and os.fstat(stream.fileno()).st_mode & 0o044:
                LOG.warning("token_file %s can be read by others: chmod 600 it", path)
            return stream.read(_LONGEST_FILE).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"token_file {path}: {_why(error)}") from error


def is_address(name: str) -> bool:
    """Return whether a host is named by its IP address."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Return whether a server that listens on this host can be reached from this machine only."""
    try:
        found = socket.getaddrinfo(host or None, 0, flags=socket.AI_PASSIVE)
    except OSError:
        return True  # listening there fails anyway, with a message of its own
    addresses = (str(info[4][0]).partition("%")[0] for info in found)
    return all(ipaddress.ip_address(address).is_loopback for address in addresses)


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")


def _at_least_tls_1_2(context: ssl.SSLContext) -> ssl.SSLContext:
    """Make a context refuse versions before TLS 1.2, which some builds of Python allow."""
    context.minimum_version = max(context.minimum_version, ssl.TLSVersion.TLSv1_2)
    return context


def _why(error: Exception) -> str:
    if isinstance(error, ssl.SSLError):
        return (error.reason or "not readable").replace("_", " ").lower()
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
