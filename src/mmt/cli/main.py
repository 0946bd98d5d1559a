"""``mmt``, and groups of commands to which installed packages add, imported on use."""

from importlib.metadata import EntryPoint
from typing import Annotated, Any, Final

import typer
from typer.core import TyperGroup

from mmt.cli.common import run_app, version
from mmt.cli.options import simplify_help
from mmt.core.errors import InputError
from mmt.core.plugins import load, offered

GROUP: Final = "mmt.commands"
"""Group of entry points for commands, each a function or a `typer.Typer`. The entry point is named
as the command, with the group's name before it if the command is in a group: ``model.list``."""


class Commands(TyperGroup):
    """A group of commands: its own, and those that packages offer."""

    prefix = ""
    """Prefix of the names of this group's entry points."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in sorted(self._added()) if name not in own)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, or None if there is none."""
        added = self._added()
        if cmd_name not in added:
            self.commands.update(dict.fromkeys(added, self))  # so that Typer proposes similar ones
            own = super().get_command(ctx, cmd_name)
            return None if own is None else simplify_help(own)
        target = _load(added[cmd_name])
        if not isinstance(target, typer.Typer):
            alone = typer.Typer(add_completion=False)
            alone.command(cmd_name)(target)
            target = alone
        command = simplify_help(typer.main.get_command(target))
        command.name = cmd_name
        if isinstance(command, Commands):
            command.prefix = f"{self.prefix}{cmd_name}."
        return command

    def _added(self) -> dict[str, EntryPoint]:
        return {
            name.removeprefix(self.prefix): entry
            for name, entry in offered(GROUP).items()
            if name.startswith(self.prefix) and "." not in name.removeprefix(self.prefix)
        }


def _load(entry: EntryPoint) -> Any:
    """Import an entry point; if that fails, return a command that raises the error when called."""
    try:
        return load(entry, f"command {entry.name.replace('.', ' ')}")
    except InputError as error:
        sentence = str(error)

    def explain() -> None:
        raise InputError(sentence)

    explain.__doc__ = sentence
    return explain


def command_group(title: str) -> typer.Typer:
    """Return a group of commands, to which entry points may add further commands.

    By its callback a group stays one with a single command, too.
    """
    return typer.Typer(
        cls=Commands, no_args_is_help=True, add_completion=False, help=title, callback=lambda: None
    )


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
