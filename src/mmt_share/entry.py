"""Start ``mmt-listen``; imports as little as `mmt.cli.entry`, for the same reason."""

from mmt.cli.entry import start


def listen() -> None:
    """Run ``mmt-listen``."""
    start("mmt_share.commands.listener")
