"""``mmt play``: the texture player's page."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from mmt.cli.common import Force, messages, stop_on_signals
from mmt.core.errors import InputError, MmtError
from mmt.core.kernel_cache import compile_kernels
from mmt.link.access import Access
from mmt.models import find_model, shipped_models
from mmt.scene import Link
from mmt.scene.files import table_from
from mmt_share.commands.visitors_page import reachable_url
from mmt_share.tables import Listening

if TYPE_CHECKING:
    from mmt_share.player.player import Player
    from mmt_share.player.results import ResultsFile

_MCAP: Final = ".mcap"


def play(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL]...", help="Files or names of shipped models; all shipped if absent."
        ),
    ] = None,
    *,
    shared: Annotated[
        str | None,
        typer.Option("--from", metavar="URL", help="Play the model that a leader shares there."),
    ] = None,
    results: Annotated[Path, typer.Option(help="Add the scenarios' rows to this file.")] = Path(
        "mmt-play.csv"
    ),
    record: Annotated[
        Path | None, typer.Option(help="Record touches into this MCAP file, one a texture.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the orders, and of recordings.")] = 0,
    host: Annotated[str, typer.Option(help="Listen on this address.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Listen on this port; 0 takes any free one.")] = 8770,
    token_file: Annotated[Path | None, typer.Option(help="A file with the token.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="PEM file: use TLS.")] = None,
    key: Annotated[Path | None, typer.Option(help="PEM file of the certificate's key.")] = None,
    everyone: Annotated[
        bool, typer.Option("--open", help="Let everyone play who reaches the port.")
    ] = False,
    force: Force = False,
) -> None:
    """Serve a page on which a person strokes textures and hears them."""
    address = {"host": host, "port": port}
    secrets = {"token_file": token_file, "certificate": certificate, "key": key}
    link = table_from(Link, "link", {**address, **secrets})
    if record is not None and record.suffix.lower() != _MCAP:
        raise InputError(f"--record {record}: the name of a recording must end in {_MCAP}")
    if shared is not None and (sources or record is not None):
        raise InputError("--from plays one shared surface: leave out models and --record")
    compile_kernels(["mmt_share.player.player"], messages.print)
    from mmt.texture.model.texture_model import TextureModel
    from mmt_share.player.player import Player
    from mmt_share.player.results import ResultsFile

    if shared is not None:
        asyncio.run(_serve_shared(shared, ResultsFile(results), link, everyone))
        return
    files = [find_model(source) for source in sources or []] or list(shipped_models().values())
    names = [file.stem for file in files]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"{', '.join(repeated)}: two textures have this name")
    player = Player(
        names,
        [TextureModel.load(file) for file in files],
        results=ResultsFile(results),
        record=record,
        replace=force,
        seed=seed,
    )
    asyncio.run(serve_until_ended(player, link, everyone=everyone))


async def _serve_shared(url: str, results: "ResultsFile", link: Link, everyone: bool) -> None:
    """Serve the surface that a leader shares, to several pages at once."""
    from mmt_share.player.following import shared_player

    table = table_from(Listening, "listening", {"url": url, "name": "player"})
    async with shared_player(table, results, messages.print) as player:
        await serve_until_ended(player, link, everyone=everyone, several=True)


async def serve_until_ended(
    player: "Player",
    link: Link,
    *,
    everyone: bool = False,
    several: bool = False,
    on_page: Callable[[str], object] = lambda _: None,
) -> None:
    """Serve pages until a signal, and print what was recorded.

    Parameters
    ----------
    player, everyone, several
        As in `PlayerServer` and its `start`.
    link
        Host and port, and what is required of a page that connects.
    on_page
        Called with the page's address.

    Raises
    ------
    MmtError
        The port cannot be used, or a recording has stopped.
    """
    from mmt_share.player.server import PlayerServer

    server = PlayerServer(player, Access.from_settings(link), several=several)
    ended = asyncio.Event()
    await server.start(link.host, link.port, everyone=everyone)
    stop_on_signals(ended.set)
    url = f"{reachable_url(link, server.port)}/player/"
    messages.print(f"player:   {url}")
    on_page(url)
    try:
        await ended.wait()
    finally:
        for path, seconds in await server.stop():
            messages.print(f"recorded: {path}, {seconds:.1f} s")
        if player.results.rows:
            messages.print(f"results:  {player.results.path}, {player.results.rows} rows more")
    if player.recording_problem is not None:
        raise MmtError(player.recording_problem)
