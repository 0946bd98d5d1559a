"""Simplify typer's help: switches without a type, arguments by name, types in plain words."""

from itertools import pairwise
from typing import Any, Final

from mmt.core.errors import InputError

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
