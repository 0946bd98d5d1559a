"""Options that several commands share, declared once as the fields of a class."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, get_type_hints


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
    return accepting(taking, parameters)


def accepting(
    function: Callable[..., None], parameters: Iterable[inspect.Parameter]
) -> Callable[..., None]:
    """Let a command that takes any keywords accept these parameters, as Typer reads them."""
    signature = inspect.Signature([*parameters])
    function.__signature__ = signature  # type: ignore[attr-defined]
    function.__annotations__ = {
        name: each.annotation for name, each in signature.parameters.items()
    }
    return function
