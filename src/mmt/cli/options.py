"""Options of commands: declared once for several commands, and shown in plain words in the help."""

import inspect
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from functools import wraps
from itertools import pairwise
from typing import Annotated, Any, Final, Literal, get_type_hints

import typer

from mmt.core.errors import InputError
from mmt.scene.table import added_flags

_WORDS: Final = {
    "bool": "",
    "int": "NUMBER",
    "int range": "NUMBER",
    "float": "NUMBER",
    "float range": "NUMBER",
    "str": "TEXT",
    "path": "PATH",
}
"""Words for an option's value, by the name of typer's type."""

_VALUES: Final = {"true", "false", "yes", "no", "on", "off"}


def with_options(function: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command to accept an option for each field of a dataclass that it takes.

    The fields are annotated and have defaults as parameters of a command; the command gets an
    instance of the class.
    """
    own = inspect.signature(function, eval_str=True).parameters
    groups: dict[str, Any] = {
        name: each.annotation for name, each in own.items() if is_dataclass(each.annotation)
    }

    @wraps(function)
    def taking(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{each.name: given.pop(each.name) for each in fields(group)})
        function(**given)

    parameters: list[inspect.Parameter] = []
    for name, each in own.items():
        if name in groups:
            types = get_type_hints(groups[name], include_extras=True)
            parameters += [
                each.replace(name=one.name, default=one.default, annotation=types[one.name])
                for one in fields(groups[name])
            ]
        else:
            parameters.append(each)
    return _accepting(taking, parameters)


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
                annotation=Annotated[
                    bool, typer.Option(flag.name, help=flag.help, rich_help_panel="Added parts")
                ],
            )
            for name, flag in flags.items()
        ]
        return _accepting(taking, parameters)

    return decorate


def _accepting(
    function: Callable[..., None], parameters: Iterable[inspect.Parameter]
) -> Callable[..., None]:
    """Let a command that takes any keywords accept these parameters, as Typer reads them."""
    signature = inspect.Signature([*parameters])
    function.__signature__ = signature  # type: ignore[attr-defined]
    function.__annotations__ = {
        name: each.annotation for name, each in signature.parameters.items()
    }
    return function


def value_of(text: str) -> Any:
    """Return a value as in TOML; text that is none is returned as it is."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def simplify_help(command: Any) -> Any:
    """Simplify the help of a typer command and its error for ``--switch true``; return it."""
    if "get_params" in vars(command):
        return command  # already done
    params, parse = command.get_params, command.parse_args

    def plain_params(context: Any) -> list[Any]:
        return [_made_plain(param) for param in params(context)]

    def explaining_parse(context: Any, arguments: list[str]) -> Any:
        switches = {name for param in params(context) if _is_switch(param) for name in param.opts}
        for name, value in pairwise(arguments):
            if name == "--":
                break
            if name in switches and value.lower() in _VALUES:
                raise InputError(f"{name} is a switch: give it without {value}, or leave it out")
        return parse(context, arguments)

    command.get_params, command.parse_args = plain_params, explaining_parse
    for each in getattr(command, "commands", {}).values():
        simplify_help(each)
    return command


def _is_switch(param: Any) -> bool:
    return bool(getattr(param, "is_flag", False))


def _made_plain(param: Any) -> Any:
    if param.param_type_name == "argument":
        name = (param.metavar or param.name.upper()).strip("[].")
        many = "..." * (param.nargs != 1)
        used = f"{name}{many}" if param.required else f"[{name}{many}]"
        param.metavar = f"{name}{many}"
        param.get_usage_pieces = lambda _: [used]
        param.display_type_rich = lambda ctx: ""  # noqa: ARG005 - called by this name
    elif _is_switch(param):
        param.metavar = ""
    elif param.metavar is None and hasattr(param, "display_type_rich"):
        shown = type(param).display_type_rich

        def words(ctx: Any) -> str:
            text = (shown(param, ctx) or "").strip("<>")
            return _WORDS.get(text, text)

        param.display_type_rich = words
    return param
