"""Read scenes, from TOML files and from recordings; what overrides the keys of a file."""

import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypeVar

from pydantic import BaseModel, ValidationError

from mmt.core.errors import InputError, naming
from mmt.scene import Scene
from mmt.scene.leader_tables import by_method, without_former
from mmt.scene.table import added_parts, explain_problems

AnyTable = TypeVar("AnyTable", bound=BaseModel)

ENVIRONMENT_PREFIX = "MMT_"
"""``MMT_LINK__PORT=9000`` overrides ``port`` of ``[link]``."""

_READ: Final = (("rendering", "model"), ("replay", "file"))
_SECURING: Final = ("token_file", "certificate", "key", "authority")
"""Keys that name input files: `_READ` by table and key, `_SECURING` in any table."""


class Overrides(NamedTuple):
    """Values that take precedence over a scene's file, by ``"table.key"``."""

    values: dict[str, Any]
    names: dict[str, str]
    """Name of each value's source for error messages, such as ``--port``."""

    @classmethod
    def collect(
        cls,
        flags: Mapping[str, Any],
        options: Mapping[str, str] | None,
        concerns: Callable[[str], bool],
    ) -> Self:
        """Return the overrides from environment variables and from flags, which win.

        Parameters
        ----------
        flags
            Values by ``"table.key"``; a value of None changes nothing.
        options
            Names of the flags for error messages, by ``"table.key"``, such as ``--port``.
        concerns
            Returns whether to use the environment variables for a table.
        """
        given = {key: value for key, value in flags.items() if value is not None}
        variables = {
            key: value
            for key, value in environment_overrides(os.environ).items()
            if concerns(key.partition(".")[0])
        }
        names = {
            key: f"environment variable {ENVIRONMENT_PREFIX}{key.replace('.', '__').upper()}"
            for key in variables
        }
        names |= {key: (options or {}).get(key, "overrides") for key in given}
        return cls({**variables, **given}, names)


def load_scene(
    path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    replay: str | Path | None = None,
    record: str | Path | None = None,
    force: bool = False,
    tables: Iterable[str] = (),
    options: Mapping[str, str] | None = None,
) -> Scene:
    """Read and validate a scene; the environment, then `overrides`, take precedence.

    Parameters
    ----------
    path
        A TOML file, or the name of an example scene such as ``demo``. Input files that the
        scene names are looked for in the current directory, then beside the scene; output
        files are relative to the current directory.
    overrides
        Values by ``"table.key"``; a value of None changes nothing.
    replay
        A recorded session to send instead of the scene's own source. A replay follows no
        commands, so the hand, the handle and the force feedback are removed as well.
    record
        File to record into; an existing file is an error. If the scene has no
        ``[recording]``, only the channels that other parts need are sent and recorded.
    force
        Whether a recording may replace an existing file.
    tables
        Names of tables to add, with default values, if the file lacks them, such as ``monitor``.
    options
        Names of the overrides for error messages, by ``"table.key"``, such as ``--port``.

    Raises
    ------
    InputError
        The file is missing or not valid TOML, or a key, a value or a combination is not
        allowed. The message names the key, the value and the allowed values.
    """
    path = find_scene(Path(path))
    found = read_tables(path)
    _change_parts(found, replay, record)
    for name in tables:
        found.setdefault(name, {})
    resolve_input_files(path, found)
    foreign = {name for part in added_parts().values() for name in part.foreign}
    given = Overrides.collect(overrides or {}, options, lambda table: table not in foreign)
    records = "recording" in found or any(key.startswith("recording.") for key in given.values)
    if force and records:
        given.values["recording.existing"] = "replace"
    return validated(Scene, str(path), found, given)


def validated(
    model: type[AnyTable], origin: str, tables: Mapping[str, Any], given: Overrides
) -> AnyTable:
    """Validate tables with their overrides; `origin` names the tables in error messages.

    Raises
    ------
    InputError
        A key, a value or a combination is not allowed.
    """
    try:
        return model.model_validate(_resolved(tables, given.values))
    except ValidationError as error:
        where = _origin(error, origin, tables, given.names)
        raise InputError(f"{where}: {explain_problems(error, model)}") from error


def read_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file, unvalidated.

    Raises
    ------
    InputError
        The file is missing or not valid TOML.
    """
    try:
        with naming(f"scene {path}"):
            return tomllib.loads(path.read_text(encoding="utf-8-sig"))  # Windows marks such files
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"scene {path}: not valid TOML: {error}") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"scene {path}: not valid TOML: byte {error.start + 1} is no UTF-8; save it as UTF-8"
        ) from error
    except RecursionError as error:
        raise InputError(
            f"scene {path}: it is nested too deep; a scene is tables of keys"
        ) from error


def _change_parts(
    tables: dict[str, Any], replay: str | Path | None, record: str | Path | None
) -> None:
    """Replace the follower's source by a recording, and set the file to record into."""
    if replay is not None:
        for name in ("simulated", "devices", "hand", "handle", "force_feedback"):
            tables.pop(name, None)
        table = tables.get("replay")
        tables["replay"] = {**(table if isinstance(table, dict) else {}), "file": str(replay)}
    if record is not None:
        table = tables.setdefault("recording", {"channels": "needed"})
        if isinstance(table, dict):
            table["file"], table["existing"] = str(record), "refuse"


def _origin(
    error: ValidationError, path: str, tables: Mapping[str, Any], names: Mapping[str, str]
) -> str:
    """Return the sources of the invalid values: the file, the names of overrides, or both."""
    found: set[str] = set()
    for problem in error.errors():
        place = ".".join(map(str, problem["loc"][:2]))
        whole = problem["loc"] and problem["loc"][0] not in tables
        added = {key for key in names if whole and key.startswith(f"{problem['loc'][0]}.")}
        given = names.keys() & {place} or added
        found |= {names[key] for key in given} or {""}
    return " and ".join([path] * ("" in found) + sorted(found - {""}))


def example_scenes() -> dict[str, Path]:
    """Return the example scenes of the installed package, or of the checkout, by name."""
    package = Path(__file__).parents[1]
    for directory in (package / "configs", package.parents[1] / "configs"):
        if directory.is_dir():
            return {path.stem: path for path in sorted(directory.glob("*.toml"))}
    return {}


def find_scene(path: Path) -> Path:
    """Return the path if the file exists, else the path of the example scene of that name.

    Raises
    ------
    InputError
        There is no such file and no such example.
    """
    if path.exists() and not path.is_dir():
        return path
    examples = example_scenes()
    if path.suffix == "" and path.name == str(path) and path.name in examples:
        return examples[path.name]
    raise InputError(
        f"scene {path}: no such file; the examples are {', '.join(examples) or 'not installed'}"
    )


def resolve_input_files(path: Path, tables: dict[str, Any]) -> None:
    """Resolve input files that the tables name: in the current directory, else beside `path`."""
    for name, table in tables.items():
        for key in table if isinstance(table, dict) else ():
            read = (name, key) in _READ or key in _SECURING
            if read and isinstance(table[key], str):
                beside = path.parent / table[key]
                if beside.exists() and not Path(table[key]).exists():
                    tables[name] = {**tables[name], key: str(beside)}


def scene_from_tables(
    tables: Mapping[str, Any], overrides: Mapping[str, Any] | None = None, *, origin: str = "scene"
) -> Scene:
    """Return the scene of parsed tables; see `load_scene`.

    Raises
    ------
    InputError
        A key, a value or a combination is not allowed.
    """
    return validated(Scene, origin, tables, Overrides(dict(overrides or {}), {}))


def scene_of_recording(tables: Mapping[str, Any], origin: str) -> Scene:
    """Return the scene that a session was recorded with, perhaps by an earlier version.

    Raises
    ------
    InputError
        The recorded scene is not valid; `origin` names it in the message.
    """
    if isinstance(tables.get("texture"), Mapping):
        tables = {**tables, "texture": by_method(tables["texture"])}
    if isinstance(tables.get("rendering"), Mapping):
        tables = {**tables, "rendering": without_former(tables["rendering"])}
    return scene_from_tables(tables, origin=origin)


def _resolved(tables: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of the tables with overrides, by ``"table.key"``, applied."""
    resolved: dict[str, Any] = {
        name: dict(table) if isinstance(table, Mapping) else table for name, table in tables.items()
    }
    for key, value in overrides.items():
        if value is None:
            continue
        table_name, _, field = key.partition(".")
        table = resolved.setdefault(table_name, {})
        if isinstance(table, dict):
            table[field] = value
    return resolved


def environment_overrides(environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the overrides from ``MMT_TABLE__KEY`` variables; lists are in TOML syntax."""
    overrides: dict[str, Any] = {}
    for name, value in environment.items():
        if name.startswith(ENVIRONMENT_PREFIX) and "__" in name:
            table, _, key = name.removeprefix(ENVIRONMENT_PREFIX).lower().partition("__")
            overrides[f"{table}.{key}"] = _value(value)
    return overrides


def _value(text: str) -> Any:
    """Return a list if the text is a TOML list, else the text, such as the host ``[::1]``."""
    try:
        return tomllib.loads(f"it = {text}")["it"] if text.startswith("[") else text
    except (tomllib.TOMLDecodeError, RecursionError):
        return text


def table_from(model: type[AnyTable], name: str, payload: object) -> AnyTable:
    """Validate one table by itself, received from the other service or given by a program.

    Raises
    ------
    InputError
        A key, a value or a combination is not allowed.
    """
    try:
        return model.model_validate(payload)
    except ValidationError as error:
        raise InputError(f"[{name}]: {explain_problems(error, model)}") from error
