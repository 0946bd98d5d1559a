"""Options that added parts give a command, and whom they let in beside the leader."""

import inspect
from collections.abc import Callable, Coroutine, Iterable
from functools import wraps
from typing import Annotated, Any, Literal, Protocol

import typer

from mmt.scene import Scene
from mmt.scene.added import Flag, added_flags, imported


class Guest(Protocol):
    """What a command runs beside the leader for others."""

    def entering(self, sentence: str) -> Coroutine[Any, Any, str] | None:
        """Return what lets them in after this event of the leader, None if it is another.

        Awaited, it gives a text for the terminal.
        """


class StayingGuest(Guest, Protocol):
    """One that may outlive the session."""

    @property
    def lasting(self) -> str | None:
        """What it offers after the session, as words behind "until Ctrl-C"; None for nothing."""

    def wait(self) -> None:
        """Wait until it has ended by itself."""

    def close(self) -> None:
        """End it."""


def invite(flags: Iterable[Flag], scene: Scene, *, terminal: bool = True) -> list[StayingGuest]:
    """Return the guests of these options; nothing is started.

    Parameters
    ----------
    flags
        The options.
    scene
        Has their tables.
    terminal
        Whether a person reads what they say, not a program.
    """
    return [imported(flag.guest)(scene, terminal=terminal) for flag in flags if flag.guest]


def with_flags(command: Literal["leader", "demo"]) -> Callable[[Callable[..., None]], Any]:
    """Decorate a command, so that it takes the options of added parts; it gets them as `flags`."""

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
        taking.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        taking.__annotations__ = {each.name: each.annotation for each in parameters}
        return taking

    return decorate
