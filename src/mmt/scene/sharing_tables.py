"""The tables of a model that is shared: ``[sharing]`` of its leader, ``[listening]`` of others."""

from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from mmt.scene.table import PartTable


class _Secured(PartTable):
    token_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    authority: Path | None = None

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both or neither")
        return self


class Sharing(_Secured):
    """``[sharing]``: the leader lets others feel the model that it builds."""

    host: str = "127.0.0.1"
    port: int = Field(8766, ge=0, le=65_535)
    most: int = Field(200, ge=1, le=10_000)
    open: bool = False
    store: Path | None = None
    accept: bool = False

    def url(self, port: int) -> str:
        """Return the address for listeners."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.certificate is not None else 'http'}://{host}:{port}"


class Listening(_Secured):
    """``[listening]``: render the model that another machine's leader shares."""

    url: str = "http://127.0.0.1:8766"
    name: str | None = Field(None, max_length=64)
    patience_s: float = Field(10.0, ge=0.5, le=3600)
