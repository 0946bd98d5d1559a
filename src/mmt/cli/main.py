"""``mmt``: sessions, evaluation, models, devices, scenes and the demonstration.

The commands are entry points, see `mmt.cli.commands`.
"""

from typing import Annotated

import typer

from mmt.cli.commands import Commands
from mmt.cli.common import run_app, version

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Model-mediated teleoperation of haptic texture.",
)


@app.callback()
def main(
    _: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Handle the options that precede a command."""


def run() -> None:
    """Run ``mmt``."""
    run_app(app, "mmt")


if __name__ == "__main__":
    run()
