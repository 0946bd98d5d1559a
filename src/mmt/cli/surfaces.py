"""``mmt surface``: tell a leader which surface is under the tool."""

import asyncio
from typing import Annotated

import typer

from mmt.cli.common import output
from mmt.core.errors import InputError

_ANOTHER = "new"


def say_surface(
    surface: Annotated[
        str,
        typer.Argument(metavar="NUMBER|new", help="A surface met before, or one that was not."),
    ],
    leader: Annotated[
        str, typer.Option(metavar="URL", help="Where the leader listens.")
    ] = "http://127.0.0.1:8765",
) -> None:
    """Tell a running leader which surface is under the tool, as its monitor's page can."""
    from mmt.link.access import Access
    from mmt.scene import Link
    from mmt.web.monitor.order_client import give_order

    try:
        number = None if surface == _ANOTHER else int(surface)
    except ValueError as error:
        raise InputError(
            f"surface is {surface!r}: give the number of one met before, or {_ANOTHER}"
        ) from error
    order = {"do": "surface", "surface": number}
    output.print(asyncio.run(give_order(leader, Access.from_settings(Link()), order)))
