"""Read scenes from files: TOML, then the environment, then the command line's flags."""

import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypeVar

from pydantic import BaseModel, ValidationError

from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.scene.added import added_parts
from mmt.scene.problems import explain_problems

AnyTable = TypeVar("AnyTable", bound=BaseModel)

ENVIRONMENT_PREFIX = "MMT_"
"""``MMT_LINK__PORT=9000`` overrides ``port`` of ``[link]``."""

_READ: Final = (("rendering", "model"), ("replay", "file"))
_SECURING: Final = ("token_file", "certificate", "key", "authority")
"""Keys that name files which a scene reads: of these tables, and of any table."""


class Overrides(NamedTuple):
    """What takes precedence over a file, by ``"table.key"``."""

    values: dict[str, Any]
    names: dict[str, str]
    """What messages call each."""

    @classmethod
    def of(
        cls,
        flags: Mapping[str, Any],
        options: Mapping[str, str] | None,
        concerns: Callable[[str], bool],
    ) -> Self:
        """Return the environment's, and the flags over them.

        Parameters
        ----------
        flags
            Values by ``"table.key"``; a value of None changes nothing.
        options
            What messages call a flag, by ``"table.key"``, such as ``--port``.
        concerns
            Whether variables of this table are meant.
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
        A TOML file, or the name of an example scene such as ``demo``. Files that it reads
        are looked for in the current directory, then beside the scene; what it writes is
        relative to the current directory.
    overrides
        Values by ``"table.key"``; a value of None changes nothing.
    replay
        A recorded session that takes the place of the scene's own follower; without a
        follower that obeys commands there is no hand, and no force to feed back to it.
    record
        Where to record. A scene that records nothing by itself has its wire as it is
        recorded, since its follower knows nothing of it. A file that exists is refused.
    force
        Whether a recording may replace a file that exists.
    tables
        Names of tables that the scene has, empty if its file has none, such as ``monitor``.
    options
        What messages call an override, by ``"table.key"``, such as ``--port``.

    Raises
    ------
    InputError
        The file is missing or no TOML, or a key, a value or a combination is not allowed;
        the message names the key, the value and what is allowed.
    """
    path = find_scene(Path(path))
    found = read_tables(path)
    _change_parts(found, replay, record)
    for name in tables:
        found.setdefault(name, {})
    look_beside(path, found)
    foreign = {name for part in added_parts().values() for name in part.foreign}
    given = Overrides.of(overrides or {}, options, lambda table: table not in foreign)
    records = "recording" in found or any(key.startswith("recording.") for key in given.values)
    if force and records:
        given.values["recording.existing"] = "replace"
    return validated(Scene, str(path), found, given)


def validated(
    model: type[AnyTable], origin: str, tables: Mapping[str, Any], given: Overrides
) -> AnyTable:
    """Validate tables with what takes precedence; `origin` is what messages call the tables.

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
    """Return the tables of a TOML file, unchecked.

    Raises
    ------
    InputError
        It is missing or no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"scene {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"scene {path}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise InputError(
            f"scene {path}: it is nested too deep; a scene is tables of keys"
        ) from error


def _change_parts(
    tables: dict[str, Any], replay: str | Path | None, record: str | Path | None
) -> None:
    """Put a recording in the follower's place, and say where to record."""
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
    """Return what the problems come from: the file with these tables, or overrides by name."""
    found: set[str] = set()
    for problem in error.errors():
        place = ".".join(map(str, problem["loc"][:2]))
        whole = problem["loc"] and problem["loc"][0] not in tables
        added = {key for key in names if whole and key.startswith(f"{problem['loc'][0]}.")}
        given = names.keys() & {place} or added
        found |= {names[key] for key in given} or {""}
    return " and ".join([path] * ("" in found) + sorted(found - {""}))


def example_scenes() -> dict[str, Path]:
    """Return the example scenes by name: of the installed package, or of the checkout."""
    package = Path(__file__).parents[1]
    for directory in (package / "configs", package.parents[1] / "configs"):
        if directory.is_dir():
            return {path.stem: path for path in sorted(directory.glob("*.toml"))}
    return {}


def find_scene(path: Path) -> Path:
    """Return the file, or the example scene of that name.

    Raises
    ------
    InputError
        There is neither.
    """
    if path.exists() and not path.is_dir():
        return path
    examples = example_scenes()
    if path.suffix == "" and path.name == str(path) and path.name in examples:
        return examples[path.name]
    raise InputError(
        f"scene {path}: no such file; the examples are {', '.join(examples) or 'not installed'}"
    )


def look_beside(path: Path, tables: dict[str, Any]) -> None:
    """Let files that tables name, and a scene reads, stand beside it."""
    for name, table in tables.items():
        for key in table if isinstance(table, dict) else ():
            read = (name, key) in _READ or key in _SECURING
            if read and isinstance(table[key], str):
                tables[name] = {**tables[name], key: _beside(path, table[key])}


def _beside(path: Path, file: str) -> str:
    """Return a file that stands beside a scene and not here as such, others as they are."""
    beside = path.parent / file
    return str(beside) if not Path(file).exists() and beside.exists() else file


def scene_from_tables(
    tables: Mapping[str, Any], overrides: Mapping[str, Any] | None = None, *, origin: str = "scene"
) -> Scene:
    """Validate tables that are already parsed; see `load_scene`.

    Raises
    ------
    InputError
        A key, a value or a combination is not allowed.
    """
    return validated(Scene, origin, tables, Overrides(dict(overrides or {}), {}))


def _resolved(tables: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables with what takes precedence, by ``"table.key"``."""
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
    """Return the overrides that ``MMT_TABLE__KEY`` variables ask for; a list is one of TOML."""
    overrides: dict[str, Any] = {}
    for name, value in environment.items():
        if name.startswith(ENVIRONMENT_PREFIX) and "__" in name:
            table, _, key = name.removeprefix(ENVIRONMENT_PREFIX).lower().partition("__")
            overrides[f"{table}.{key}"] = _value(value)
    return overrides


def _value(text: str) -> Any:
    """Return the list that a text is in TOML, else the text, such as the host ``[::1]``."""
    try:
        return tomllib.loads(f"it = {text}")["it"] if text.startswith("[") else text
    except (tomllib.TOMLDecodeError, RecursionError):
        return text


def table_from(model: type[AnyTable], name: str, payload: object) -> AnyTable:
    """Validate one table by itself, as it comes from the other side or a program.

    Raises
    ------
    InputError
        A key, a value or a combination is not allowed.
    """
    try:
        return model.model_validate(payload)
    except ValidationError as error:
        raise InputError(f"[{name}]: {explain_problems(error, model)}") from error
