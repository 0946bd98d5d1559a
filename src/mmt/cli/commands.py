"""Groups of commands to which installed packages add theirs, imported when they are used."""

from importlib.metadata import EntryPoint
from typing import Any, Final

import typer
from typer.core import TyperGroup

from mmt.cli.plain_help import made_plain
from mmt.core.errors import InputError
from mmt.core.plugins import load, offered

GROUP: Final = "mmt.commands"
"""The entry points of commands, each a function or a `typer.Typer`: named as the command, one of a
group with that group's name, as ``model.list``."""


class Commands(TyperGroup):
    """A group of commands: those that it has, and those that packages offer."""

    prefix = ""
    """What the names of this group's entry points begin with."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in sorted(self._added()) if name not in own)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, None where there is none."""
        added = self._added()
        if cmd_name not in added:
            own = super().get_command(ctx, cmd_name)
            return None if own is None else made_plain(own)
        target = _load(added[cmd_name])
        if not isinstance(target, typer.Typer):
            alone = typer.Typer(add_completion=False)
            alone.command(cmd_name)(target)
            target = alone
        command = made_plain(typer.main.get_command(target))
        command.name = cmd_name
        if isinstance(command, Commands):
            command.prefix = f"{self.prefix}{cmd_name}."
        return command

    def _added(self) -> dict[str, EntryPoint]:
        start = len(self.prefix)
        return {
            name[start:]: entry
            for name, entry in offered(GROUP).items()
            if name.startswith(self.prefix) and "." not in name[start:]
        }


def _load(entry: EntryPoint) -> Any:
    """Return what an entry point names; one that cannot be imported says so when it is called."""
    try:
        return load(entry, f"command {entry.name.replace('.', ' ')}")
    except InputError as error:
        sentence = str(error)

    def explain() -> None:
        raise InputError(sentence)

    explain.__doc__ = sentence
    return explain


def command_group(title: str) -> typer.Typer:
    """Return a group of commands, to which others may be added by entry points."""
    return typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, help=title)
