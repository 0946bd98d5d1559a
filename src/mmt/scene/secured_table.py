"""Base classes for the tables of connections: token, certificates and address."""

import re
from pathlib import Path
from typing import Self

from pydantic import Field, field_validator, model_validator

from mmt.scene.table import PartTable


class SecuredTable(PartTable):
    """Base class: token, certificate, key and authority of one side of a connection."""

    token_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    authority: Path | None = None

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both or neither")
        return self


class ServedTable(SecuredTable):
    """Base class for tables of the side that listens."""

    host: str = "127.0.0.1"
    port: int = Field(0, ge=0, le=65_535)
    open: bool = False
    allow_origins: tuple[str, ...] = ()

    @field_validator("allow_origins")
    @classmethod
    def _origins(cls, origins: tuple[str, ...]) -> tuple[str, ...]:
        for origin in origins:
            if not re.fullmatch(r"[a-z][a-z0-9+.-]*://[^/\s*]+", origin):
                raise ValueError(
                    f"{origin!r} is no origin: one is as https://lab.example or "
                    "http://127.0.0.1:5173, without a path"
                )
        return origins

    def url(self, port: int | None = None) -> str:
        """Return the URL for the other side, with `port`, or the table's port if None."""
        secure = self.certificate is not None or self.authority is not None
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if secure else 'http'}://{host}:{self.port if port is None else port}"
