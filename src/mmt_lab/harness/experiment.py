"""Definition of an experiment, options that experiments share, and the search for experiments.

An experiment is a module of `mmt_lab.experiments`. Its name is that of the module, with hyphens.
The module's docstring describes the experiment, and the module says for the list what it shows and
how long it takes with its defaults on an ordinary machine::

    SHOWS: Final = "how ... depends on ..."
    TAKES: Final = "2 min"

    def run(textures: Textures = None, seeds: Seeds = 3, workers: Workers = None) -> Findings:
        ...

A stage of ``mmt bench``, which measures against peers, has ``GROUP: Final = "bench"`` too. The
parameters of ``run`` are the options and arguments of the command, annotated as Typer reads them.
Options of several experiments are defined here, so that they mean the same everywhere. The harness
adds ``--json`` and ``--report``.
"""

import ast
import importlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import typer

from mmt.core.errors import InputError
from mmt.core.frames import check_acceleration_rate
from mmt.scene import Hand
from mmt.scene.device_tables import HAND_KINDS
from mmt.scene.files import table_from
from mmt.texture.signals.metrics import Spectra
from mmt_lab import experiments
from mmt_lab.harness.findings import Findings

Group = Literal["lab", "bench"]

Seeds = Annotated[
    int, typer.Option(min=1, help="Sessions, of as many seeds, of each case.", show_default=True)
]
"""Number of seeds of each case, counted from the first one."""

Seed = Annotated[int, typer.Option(min=0, help="The first seed; the same one repeats a run.")]
"""The first seed of everything random."""

Textures = Annotated[
    str | None,
    typer.Option(
        metavar="NAME,FILE",
        help="Known textures, models (.npz, .xml), folders of models, drawn; all known if absent.",
    ),
]
"""Names of known textures between commas; see `chosen_textures`."""

HandKind = Annotated[
    str,
    typer.Option(
        metavar="KIND", help=f"The hand: {', '.join(HAND_KINDS)}, or a recorded stroke (.npz)."
    ),
]
"""Kind of the simulated hand, ``kind`` of ``[hand]``; see `hand_of`."""

AccelerationRates = Annotated[
    str,
    typer.Option(metavar="HZ,HZ", help="Rates of the acceleration: 1000, 2000 and on to 10000."),
]
"""Rates of the acceleration between commas; see `rates_of`."""

AccelerationRate = Annotated[
    int, typer.Option(metavar="HZ", help="Link and services: acceleration_rate_hz.")
]
"""Rate of the acceleration of a run of both services."""

Strangers = Annotated[
    bool, typer.Option("--strangers", help="Services: beside strangers at the port.")
]
"""Whether services are measured beside strangers."""

Loss = Annotated[
    bool, typer.Option("--loss", help="Link: the services over paths that lose packets.")
]
"""Whether services are measured over paths that lose packets, and not the link."""

Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Local processes; as many as there are processors if absent."),
]
"""Number of local processes; see `mmt_lab.harness.processes.map_in_processes`."""

SpectraOption = Annotated[
    Spectra,
    typer.Option("--spectra", help="What the GFC compares: Welch's spectra or raw Fourier ones."),
]
"""How the amplitude spectra of a GFC are made."""

Duration = Annotated[float, typer.Option(help="Seconds for each measurement of link and services.")]
"""Length of a measurement in real time."""

RealTime = Annotated[
    bool,
    typer.Option(
        "--realtime",
        help="Link and devices: by real-time scheduling. Services: with and without it.",
    ),
]
"""Whether real-time scheduling is measured (Linux)."""


class Experiment(NamedTuple):
    """Entry of the list of experiments, read without importing the module."""

    name: str
    shows: str
    takes: str
    group: Group


def listed(group: Group | None = None) -> Iterator[Experiment]:
    """Yield every experiment of a group, or of all, by name.

    The modules are read, not imported: numerics take seconds to load.
    """
    for name, (_, file) in _found().items():
        one = _read(name, file)
        if group in {None, one.group}:
            yield one


def load(name: str) -> Callable[..., Findings]:
    """Import an experiment by its name; return the function that runs it.

    Raises
    ------
    InputError
        There is no such experiment.
    ImportError
        The experiment needs a package that is not installed.
    """
    found = _found()
    if name not in found:
        raise InputError(f"lab {name}: allowed are {', '.join(found)}")
    run: Callable[..., Findings] = importlib.import_module(found[name][0]).run
    return run


def _found() -> dict[str, tuple[str, Path]]:
    """Return module and file of each experiment by its name, in alphabetical order."""
    found = {}
    for folder in map(Path, experiments.__path__):
        for file in folder.rglob("[!_]*.py"):
            place = file.relative_to(folder).with_suffix("").parts
            module = ".".join((experiments.__name__, *place))
            found[file.stem.replace("_", "-")] = module, file
    return dict(sorted(found.items()))


def chosen_textures(textures: str | None) -> list[str]:
    """Return the textures named between the commas of ``--textures``, all known ones if absent.

    A folder stands for the models in it, sorted by name; ``drawn`` and ``final`` each stand for
    their first `DRAWN` textures. An alteration after a + applies to all of them.

    Raises
    ------
    InputError
        There is no such texture, or no model in a folder.
    """
    from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface

    if textures is None:
        return list(SURFACES)
    chosen: list[str] = []
    for name in names_of(textures):
        whole, plus, altered = (name, "", "") if Path(name).exists() else name.partition("+")
        if Path(whole).is_dir():
            found = sorted(Path(whole).glob("[!.]*"))
            files = [f for f in found if f.suffix.lower() in _MODELS]
            if not files:
                raise InputError(f"--textures {name}: no model (.npz, .xml) is in this folder")
            chosen += [f"{file}{plus}{altered}" for file in files]
        elif whole in {"drawn", "final"}:
            chosen += [f"{whole}-{number}{plus}{altered}" for number in range(DRAWN)]
        else:
            chosen.append(name)
    for name in chosen:
        get_surface(name)
    return chosen


def names_of(listed: str | None) -> list[str]:
    """Return the names between the commas of an option, none if it is absent."""
    return [] if listed is None else [name.strip() for name in listed.split(",")]


def chosen_names(option: str, listed: str, known: Iterable[str]) -> list[str]:
    """Return the names between the commas of an option; `InputError` unless all are known."""
    names = names_of(listed)
    if not set(names) <= set(known) or len(set(names)) != len(names):
        raise InputError(f"{option} {listed}: name some of {', '.join(known)}, each once")
    return names


def rates_of(listed: str) -> list[int]:
    """Return the rates between the commas of ``--acceleration-rate``.

    Raises
    ------
    InputError
        A rate is not allowed in a scene, not a number, or named twice.
    """
    texts = listed.split(",")
    if not all(text.isdecimal() for text in texts) or len(set(texts)) < len(texts):
        raise InputError(f"--acceleration-rate {listed}: name each rate once, as 1000,10000")
    rates_hz = [int(text) for text in texts]
    for rate_hz in rates_hz:
        check_acceleration_rate(rate_hz)
    return rates_hz


def hand_of(kind: str, *, isotropic: bool = True) -> Hand:
    """Return a hand of a kind, which takes all headings unless a texture is isotropic.

    Raises
    ------
    InputError
        There is no such kind.
    """
    headings = "opposite" if isotropic else "all"
    return table_from(Hand, "hand", {"kind": kind, "headings": headings})


DRAWN: Final = 20
"""Number of textures that ``drawn`` and ``final`` stand for."""

_MODELS: Final = (".npz", ".xml")


def _read(name: str, path: Path) -> Experiment:
    """Return the list's entry of an experiment, read from the source of its module."""
    said: dict[str, Any] = {"GROUP": "lab"}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case (
                ast.Assign(targets=[ast.Name(key)], value=ast.Constant(value))
                | ast.AnnAssign(target=ast.Name(key), value=ast.Constant(value))
            ):
                said[key] = value
    try:
        return Experiment(name, said["SHOWS"], said["TAKES"], said["GROUP"])
    except KeyError as error:
        raise TypeError(f"{path}: an experiment needs SHOWS and TAKES, plain texts") from error
