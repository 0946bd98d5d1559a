"""``mmt model list``, ``push`` and ``pull``: the shipped models, and those of a leader's store."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mmt.cli.common import (
    Force,
    json_option,
    messages,
    output,
    write_json,
)
from mmt.cli.models import SUFFIX
from mmt.core.errors import naming
from mmt.core.files.existing import require_absent
from mmt.core.output.tables import plain_table

if TYPE_CHECKING:
    from mmt_share.store.client import RemoteStore

_SHOWN = 12  # digits of a hash: enough to name it


def _remote(url: str) -> "RemoteStore":
    from mmt.link.access import Access
    from mmt_share.messages import TOKEN_VARIABLE
    from mmt_share.store.client import RemoteStore
    from mmt_share.tables import Listening

    return RemoteStore(
        url, Access.from_settings(Listening(), variable=TOKEN_VARIABLE, table="listening")
    )


def list_models(
    store: Annotated[
        str | None, typer.Option("--from", metavar="URL", help="List those of a leader's store.")
    ] = None,
    json_file: Annotated[Path | None, json_option("Write it there.")] = None,
) -> None:
    """List the shipped models, or those of a store."""
    from mmt.models import shipped_models
    from mmt.texture.model.file import unpack

    if store is not None:
        _list_store(store, json_file)
        return
    figures = {}
    table = plain_table("", "name", "inputs", "samples", "order", "bytes")
    for name, path in shipped_models().items():
        samples = unpack(path.read_bytes()).samples
        figures[name] = {
            "inputs": samples.space.name,
            "samples": len(samples),
            "order": int(samples.lsf.shape[1]),
            "file_bytes": path.stat().st_size,
        }
        table.add_row(name, *map(str, figures[name].values()))
    output.print(table)
    write_json(json_file, figures)


def _list_store(url: str, json_file: Path | None) -> None:
    """Print the models of a store, the newest first."""
    entries = _remote(url).entries()
    table = plain_table(
        "", "name", "hash", "made", "who", "licence", "samples", "error (dB)", "note"
    )
    for entry in entries:
        error = "" if entry.error_db is None else f"{entry.error_db:.2f}"
        table.add_row(
            *(entry.name, entry.hash[:_SHOWN], entry.made, entry.who, entry.licence),
            *(str(entry.samples), error, entry.note),
        )
    output.print(table)
    write_json(json_file, [vars(entry) for entry in entries])


def pull(
    name: Annotated[str, typer.Argument(help="The model's name, or its hash.")],
    store: Annotated[str, typer.Option("--from", metavar="URL", help="The leader's store.")],
    target: Annotated[
        Path | None, typer.Option("--output", help="The file; NAME.npz if absent.")
    ] = None,
    force: Force = False,
) -> None:
    """Fetch a model from a leader's store; an interrupted transfer is resumed."""
    remote = _remote(store)
    entry = remote.find(name)
    file = target or Path(f"{_file_name(entry.name)}{SUFFIX}")
    require_absent(file, force=force)
    remote.fetch(entry.hash, file)
    licence = f", licence {entry.licence}" if entry.licence else ", without a licence"
    messages.print(f"model: {file} ({entry.name}{licence})")


def push(
    source: Annotated[Path, typer.Argument(metavar="MODEL", help="A .npz file.")],
    store: Annotated[str, typer.Option("--to", metavar="URL", help="The leader's store.")],
    name: Annotated[str | None, typer.Option(help="Its name; the file's if absent.")] = None,
    who: Annotated[str, typer.Option(help="Who made it.")] = "",
    licence: Annotated[str, typer.Option(help="Terms under which it may be used.")] = "",
    note: Annotated[str, typer.Option(help="Anything else.")] = "",
    error_db: Annotated[
        float | None, typer.Option(help="Its power error over the plane (dB), where it is known.")
    ] = None,
    json_file: Annotated[Path | None, json_option("Write what the store says of it.")] = None,
) -> None:
    """Add a model to a leader's store."""
    from mmt.texture.model.file import unpack
    from mmt_share.store.store import Entry

    with naming(f"model {source}"):
        data = source.read_bytes()
        unpack(data)
    description = Entry(name or source.stem, who, licence, note, error_db=error_db)
    entry = _remote(store).push(data, description)
    messages.print(f"stored as {entry.name} ({entry.hash[:_SHOWN]})")
    write_json(json_file, vars(entry))


def _file_name(name: str) -> str:
    """Return a name that is safe for a file: without folders, not hidden."""
    plain = "".join(c if c.isalnum() or c in "._- " else "-" for c in name).strip(" .")
    return plain or "model"
