"""Import a recording: read its files, join them on one clock, map, make frames, and report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.files.untrusted import require_fetched
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, FRAMES_HZ, Channel, samples_per_frame
from mmt.core.rotations import turn_into_scene
from mmt.session.data import RecordedSession
from mmt.session.formats import find_format, suffixes
from mmt.session.importing.checks import ImportReport, assess
from mmt.session.importing.columns import SourceColumns, named, reading, wanted_names
from mmt.session.importing.framing import on_the_grid, to_frames
from mmt.session.importing.joining import joined
from mmt.session.importing.mapping import to_samples
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions, quantity_of
from mmt.session.importing.reading_child import TEXTS, read_limited
from mmt.session.importing.samples import ROW_NUMBER, Samples
from mmt.session.importing.stamps import Stamps
from mmt.session.importing.tidy import read_apart


def options_of_each(options: ImportOptions, paths: Sequence[Path]) -> list[ImportOptions]:
    """Split the options for several files, which map ``FILE:COLUMN``, into options for each.

    Raises
    ------
    InputError
        Two files have the same name, an option is for none of them, or the axes of a channel are
        of several.
    """
    names = [path.name for path in paths]
    if len(set(names)) < len(names):
        raise InputError(f"import {', '.join(map(str, paths))}: each file needs a name of its own")
    for name in set(options.offsets) - set(names[1:]):
        raise InputError(
            f"--offset {name}=...: offsets are of {', '.join(names[1:])}, to {names[0]}"
        )
    of_each: dict[str, dict[str, str]] = {name: {} for name in names}
    constants: dict[str, str] = {}
    file_of: dict[str, str] = {}
    for target, text in options.columns.items():
        name, colon, column = text.removeprefix("-").partition(":")
        if colon and name in of_each:
            other = file_of.setdefault(quantity_of(target), name)
            if other != name and not target.endswith("time"):
                raise InputError(
                    f"--map {target}={text}: its other axes are of {other}, and the axes of a "
                    "channel must be of one file; put their columns into one first"
                )
            of_each[name][target] = f"-{column}" if text.startswith("-") else column
        else:
            constants[target] = text
    for target, text in constants.items():
        kind = quantity_of(target)
        owner = next((each for each in of_each.values() if kind in map(quantity_of, each)), None)
        if owner is None or not text.removeprefix("-").replace(".", "", 1).isdecimal():
            raise InputError(f"--map {target}={text}: say of which file, as {names[0]}:{text}")
        owner[target] = text
    return [replace(options, columns=columns, offsets={}) for columns in of_each.values()]


_TEXTS: Final = (*TEXTS, ".gz")
_BOOKS: Final = (".xlsx",)
_KINDS_OF_OPTIONS: Final = {
    **dict.fromkeys(("separator", "decimal"), _TEXTS),
    **dict.fromkeys(("header", "missing"), _TEXTS + _BOOKS),
    "sheet": _BOOKS,
}


def import_recording(
    paths: str | Path | Sequence[str | Path], options: ImportOptions | None = None
) -> tuple[RecordedSession, ImportReport]:
    """Read another program's recording, resampled to 1 kHz; return the session and a report.

    Raises
    ------
    InputError
        See `mmt.session.files.import_session`.
    """
    files = [Path(p) for p in ([paths] if isinstance(paths, str | Path) else paths)]
    if not files:
        raise InputError("there is no file to import")
    options = options or ImportOptions()
    check_kinds(files, options)
    each = options_of_each(options, files) if len(files) > 1 else [options]
    read = [read_columns(f, wanted_names(o), o) for f, o in zip(files, each, strict=True)]
    return import_columns(read, files, options)


def check_kinds(files: Sequence[Path], options: ImportOptions) -> None:
    """Check that the options apply to these kinds of files.

    Raises
    ------
    InputError
        An option does not.
    """
    for name, known in _KINDS_OF_OPTIONS.items():
        if getattr(options, name) and not any(file.suffix.lower() in known for file in files):
            raise InputError(f"--{name} is for {', '.join(known)}: leave it out")
    if options.offsets and len(files) == 1:
        raise InputError("--offset is for several files of one recording: leave it out")


def import_columns(
    read: Sequence[SourceColumns], files: Sequence[Path], options: ImportOptions
) -> tuple[RecordedSession, ImportReport]:
    """Import columns that were read from files; see `import_recording`.

    Raises
    ------
    InputError
        See `mmt.session.files.import_session`.
    """
    each = options_of_each(options, files) if len(files) > 1 else [options]
    columns, others = read[0], [file.name for file in files[1:]]
    frames, resampled = columns.frames, False
    asked_hz = options.acceleration_rate_hz
    episode = options.episode if columns.episode is None else None
    given = replace(options, reading_memory_gb=None, reading_time_s=None, episode=episode)
    plain = replace(given, acceleration_rate_hz=None) == ImportOptions()
    unchanged = (
        plain
        and len(read) == 1
        and frames is not None
        and asked_hz in (None, FRAMES_HZ * samples_per_frame(frames.dtype))
    )
    with named(", ".join([columns.origin, *others])):
        if frames is not None and unchanged:
            samples, stamps = _of_frames(frames)
            later_ns = 0
        else:
            samples = _gathered(read, each, [file.name for file in files], options)
            frames, stamps, resampled = to_frames(
                samples, options.longest_gap_s, options.stamps, options.acceleration_rate_hz
            )
            samples = replace(samples, notes=(*samples.notes, *_turn(frames, options)))
            later_ns = int(frames["time_ns"][0])
            if _date_ns(columns, each[0]) is not None:
                later_ns += _first_ns(frames, stamps, resampled=resampled)
    began_ns = columns.began_utc_ns
    session = RecordedSession(
        frames=frames,
        scene=columns.scene,
        annotations=columns.annotations,
        events=[*columns.events, *({"time_s": 0.0, "event": note} for note in samples.notes)],
        path=files[0],
        began_utc_ns=None if began_ns is None else began_ns + later_ns,
    )
    report = assess(frames, samples, stamps, options, resampled=resampled)
    notes = [note for part in read for note in part.notes]
    return session, replace(report, warnings=(*notes, *samples.notes, *report.warnings))


def _gathered(
    read: Sequence[SourceColumns],
    each: Sequence[ImportOptions],
    names: Sequence[str],
    options: ImportOptions,
) -> Samples:
    """Map, check and join the columns of the files of one recording."""
    own = [is_timed(c, replace(o, rate_hz=None)) for c, o in zip(read, each, strict=True)]
    rates = [None if timed and not all(own) else options.rate_hz for timed in own]
    each = [replace(o, rate_hz=rate_hz) for o, rate_hz in zip(each, rates, strict=True)]
    numbered = any("sequence" in columns.values for columns in read)
    parts = []
    for columns, own_options in zip(read, each, strict=True):
        with named(columns.origin):
            part = to_samples(columns, own_options)
            part = part.without_blanks() if options.blanks_as_gaps else part
            parts.append(part if numbered else part.without_repeats())
            parts[-1].check()
    return joined(parts, names, options.offsets, list(map(_date_ns, read, each)))


def is_timed(columns: SourceColumns, options: ImportOptions) -> bool:
    """Return whether rows have times: columns of them, a rate, or those of messages."""
    standard = {target for target, name in STANDARD_NAMES.items() if name in columns.names}
    of_messages = any(text.startswith("/") for text in options.columns.values())
    of_columns = any(target.endswith("time") for target in (*options.columns, *standard))
    return bool(columns.times) or options.rate_hz is not None or of_messages or of_columns


def _date_ns(columns: SourceColumns, options: ImportOptions) -> int | None:
    """Return the date from which a file's times count, if these are not those of a column."""
    own = set(STANDARD_NAMES.values())
    mapped = any(t.endswith("time") and name not in own for t, name in options.columns.items())
    return None if mapped else columns.began_utc_ns


def _turn(frames: RecordArray, options: ImportOptions) -> list[str]:
    """Turn the channels that are in the tool's axes, in place; return a note if there are any."""
    channels = [channel for channel in CHANNELS if channel in options.tool_axes]
    if not channels:
        return []
    needed: list[Channel] = [*channels, "orientation"]
    lacking = [each for each in needed if FIELD_OF_CHANNEL[each] not in (frames.dtype.names or ())]
    if lacking:
        raise InputError(
            f"--tool-axes {channels[0]}: there is no {lacking[0]}; map its columns (--map)"
        )
    turn_into_scene(frames, channels)
    return [f"{' and '.join(channels)} were turned from the tool's axes"]


def _first_ns(frames: RecordArray, stamps: Mapping[Channel, Stamps], *, resampled: bool) -> int:
    """Return the time in the file that is zero in frames; its first samples may be earlier."""
    if resampled:
        return round(1e9 * min(float(each.time_s[0]) for each in stamps.values()))
    channel, found = next(iter(stamps.items()))
    last = samples_per_frame(frames.dtype) - 1 if channel == "acceleration" else 0
    return round(float(found.time_s[last]) * 1e9)


def _of_frames(frames: RecordArray) -> tuple[Samples, dict[Channel, Stamps]]:
    """Return the samples and stamps of frames (n,) that are imported unchanged."""
    if len(frames) < 2:
        raise InputError(f"it holds {len(frames)} frames, at least 2 are needed")
    whole = RecordedSession(frames)
    vectors, numbers = whole.vectors(), frames["sequence"].astype(np.int64)
    values = {c: vectors[FIELD_OF_CHANNEL[c]].astype(np.float64) for c in whole.channels}
    stamps = on_the_grid(values, whole.time_s, numbers, whole.samples_per_frame)
    times = {channel: each.time_s for channel, each in stamps.items()}
    return Samples(values, times, dict.fromkeys(values, ROW_NUMBER.format)), stamps


def read_columns(
    path: Path, wanted: Callable[[str], bool], options: ImportOptions | None = None
) -> SourceColumns:
    """Read the columns of a file whose names are `wanted`, a function that can be pickled.

    Raises
    ------
    InputError
        The file is missing, of an unknown kind or not valid, a package that reads it is not
        installed, or see `mmt.session.importing.reading_child.read_limited`.
    """
    options = options or ImportOptions()
    if not (path.suffix or path.exists()):
        raise InputError(f"session {path}: No such file or directory")
    read = find_format("import", path)
    if read is None:
        given = path.suffix or "a name without suffix"
        raise InputError(
            f"session {path}: {given} cannot be read; the suffix must be one of "
            f"{', '.join(suffixes('import'))}, or the name that of a folder with a ROS 2 bag or a "
            "LeRobot data set"
        )
    with named(f"import {path}"):
        if path.is_file():
            with reading("a file that can be read"):
                require_fetched(path)
        columns = read_limited(path, options, read_apart, read, path, wanted, options)
    return replace(columns, origin=columns.origin or f"import {path}")
