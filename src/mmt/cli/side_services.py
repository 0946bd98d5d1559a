"""Flags that added parts give a command, and the services that run beside the leader."""

import inspect
from collections.abc import Callable, Coroutine, Iterable
from functools import wraps
from typing import Annotated, Any, Literal, Protocol

import typer

from mmt.cli.option_groups import accepting
from mmt.scene import Scene
from mmt.scene.added import Flag, added_flags, imported


class SideService(Protocol):
    """A service for other people that a command runs beside the leader, such as a page."""

    def start_on_event(self, sentence: str) -> Coroutine[Any, Any, str] | None:
        """Return a coroutine that starts the service on this event of the leader, or None.

        The coroutine returns a text for the terminal.
        """


class LastingSideService(SideService, Protocol):
    """A service that may run longer than the session."""

    @property
    def after_session(self) -> str | None:
        """Words after "until Ctrl-C" on what the service offers after the session, or None."""

    def wait(self) -> None:
        """Wait until the service has ended by itself."""

    def close(self) -> None:
        """End the service."""


def create_side_services(
    flags: Iterable[Flag], scene: Scene, *, terminal: bool = True
) -> list[LastingSideService]:
    """Return the side services of these flags, not started.

    Parameters
    ----------
    flags
        The flags; some have no side service.
    scene
        A scene with the flags' tables.
    terminal
        Whether their texts are shown to a person rather than read by a program.
    """
    return [
        imported(flag.side_service)(scene, terminal=terminal) for flag in flags if flag.side_service
    ]


def with_flags(command: Literal["leader", "demo"]) -> Callable[[Callable[..., None]], Any]:
    """Decorate a command to accept the flags of added parts, passed as the argument `flags`."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(function, eval_str=True).parameters
        named = {flag.name.strip("-").replace("-", "_"): flag for flag in added_flags(command)}
        flags = {name: flag for name, flag in named.items() if name not in own}

        @wraps(function)
        def taking(**options: Any) -> None:
            given = [flag for name, flag in flags.items() if options.pop(name)]
            function(flags=given, **options)

        parameters = [each for name, each in own.items() if name != "flags"]
        parameters += [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=False,
                annotation=Annotated[bool, typer.Option(flag.name, help=flag.help)],
            )
            for name, flag in flags.items()
        ]
        return accepting(taking, parameters)

    return decorate
