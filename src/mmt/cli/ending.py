"""What a person reads at the end of a run: outcome, model, error, files, and what was unusual."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

_LATE_SHARE: Final = 0.05
"""Share of ticks over 1 ms late from which on it is said."""


class _Fault(NamedTuple):
    """A counter that stays 0 in a run where all is well."""

    path: str
    """Where it is in a summary; ``*`` stands for each table there."""
    one: str
    many: str
    more: str = ""


_FAULTS: Final = (
    _Fault("link.lost", "frame or command", "frames or commands", "lost on the way"),
    _Fault("link.dropped", "message", "messages", "dropped before sending: the link was too slow"),
    _Fault("link.out_of_order", "message", "messages", "out of order"),
    _Fault("link.repeated", "message", "messages", "repeated"),
    _Fault("link.rejected", "message", "messages", "rejected"),
    _Fault("link.clock.jumps", "jump of the other side's clock", "jumps of the other side's clock"),
    _Fault("backfill.lost", "frame", "frames", "missing and never filled in"),
    _Fault("backfill.gone", "frame", "frames", "asked for again, but no longer kept"),
    _Fault("texture.dropped_frames", "frame", "frames", "not modelled: the model was too slow"),
    _Fault("texture.late_frames", "frame", "frames", "too late for the model"),
    _Fault("texture.tasks.*.drops", "item", "items", "dropped before {name}: it was too slow"),
    _Fault("generator.late_blocks", "block", "blocks", "of the generator too late to be rendered"),
    _Fault("vibration.playout.resyncs", "restart of the playout", "restarts of the playout"),
    _Fault("vibration.actuator.clipped", "sample", "samples", "clipped at the actuator's limit"),
    _Fault("recording.dropped", "frame", "frames", "not recorded: the disk was too slow"),
    _Fault("commands.silences", "silence of the leader", "silences of the leader"),
    _Fault("commands.implausible_commands", "command", "commands", "with an impossible echo"),
    _Fault("commands.stale_commands", "command", "commands", "too old when it arrived"),
    _Fault("commands.clipped_commands", "command", "commands", "outside the workspace"),
    _Fault("commands.halts", "halt of the robot", "halts of the robot"),
    _Fault("handle.losses", "loss of the handle", "losses of the handle"),
    _Fault("handle.faults", "fault of the handle", "faults of the handle"),
    _Fault("devices.*.losses", "loss of the {name}", "losses of the {name}"),
    _Fault("devices.*.faults", "fault of the {name}", "faults of the {name}"),
    _Fault("devices.*.clock_jumps", "jump of the {name}'s clock", "jumps of the {name}'s clock"),
)


def ending_lines(
    summaries: Mapping[str, Mapping[str, Any]],
    evaluation: Mapping[str, Any] | None = None,
    report: Path | None = None,
) -> list[str]:
    """Return what a person wants to know of a run that has ended.

    Parameters
    ----------
    summaries
        Of the leader, the follower, or both, by these names, as ``--json`` has them.
    evaluation
        Of the recording, as ``--json`` has it; None or empty where nothing was evaluated.
    report
        The page that was written of it.
    """
    leader = summaries.get("leader", {})
    main = leader or summaries.get("follower", {})
    lines = [("outcome", _outcome(main))] if main else []
    if leader.get("texture"):
        lines.append(("model", _model(leader["texture"])))
    lines += [("error", text) for text in _errors(evaluation or {})]
    if main.get("link"):
        received = f"{main['link']['frames']}"
        lines.append(("frames", received + (_missing(main) if leader else " sent")))
    for name, summary in summaries.items():
        lines += [("unusual", sentence) for sentence in unusual(name, summary)]
    recording = leader.get("recording", {}).get("file")
    files = [str(file) for file in (recording, report) if file is not None]
    if files:
        lines.append(("files", ", ".join(files)))
    whole = not leader.get("recording", {}).get("error")
    lines.append(("next", _next(recording, report, whole=whole)))
    return [f"{name + ':':<10} {text}" for name, text in lines]


def unusual(name: str, summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each thing in a service's summary that a good run does not have."""
    filled = "filled" in summary.get("backfill", {})
    told = {"link.lost"} if filled else set()  # the line of the frames has what became of them
    recording = summary.get("recording", {})
    error = recording.get("error")
    told |= {"recording.dropped"} if error else set()
    found = [
        _counted(fault, count, place)
        for fault in _FAULTS
        if fault.path not in told
        for place, count in _values(summary, fault.path.split("."))
        if count
    ]
    if signal_faults := ((summary.get("texture") or {}).get("faults") or {}).get("text"):
        found.append(f"not measured: {signal_faults}")
    if generator_fault := summary.get("generator", {}).get("fault"):
        found.append(f"{generator_fault}; our model was rendered in its place")
    late = summary.get("ticks", {}).get("late_share_1ms") or 0.0
    if late > _LATE_SHARE:
        found.append(f"{late:.0%} of the ticks over 1 ms late".replace("%", " %"))
    if error:
        found.append(f"the recording failed: {error}; {recording['dropped']} frames are not in it")
    return [f"{name}: {sentence}" for sentence in found]


def _values(
    table: Mapping[str, Any], path: list[str], place: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield what is at a path, with the name of the table that stood for ``*``."""
    first, *rest = path
    names = list(table) if first == "*" else [first]
    for name in names:
        value = table.get(name)
        place_here = str(name).replace("_", " ") if first == "*" else place
        if not rest:
            yield place_here, value
        elif isinstance(value, Mapping):
            yield from _values(value, rest, place_here)


def _counted(fault: _Fault, count: Any, place: str) -> str:
    kinds = ""
    if isinstance(count, Mapping):
        kinds = f" ({', '.join(str(kind).replace('_', ' ') for kind in count)})"
        count = sum(count.values())
    elif isinstance(count, list | tuple):
        count = len(count)
    what = fault.one if count == 1 else fault.many
    text = f"{count} {what}{' ' * bool(fault.more)}{fault.more}{kinds}"
    return text.replace("{name}", place)


def _missing(summary: Mapping[str, Any]) -> str:
    gaps = summary.get("backfill")
    if not gaps:
        return f", {summary['link']['lost']} missing"
    filled, lost = gaps["filled"], gaps["lost"]
    return f" in time, {gaps['missing']} missing: {filled} filled in, {lost} lost"


def _outcome(summary: Mapping[str, Any]) -> str:
    duration_s = summary.get("session", {}).get("duration_s")
    after = "" if duration_s is None else f" after {duration_s:.1f} s"
    return f"{summary['outcome']}{after}"


def _model(texture: Mapping[str, Any]) -> str:
    start_s, stop_s = texture.get("start_s"), texture.get("stop_s")
    if start_s is None:
        state = "never ready: the start criterion was not met"
    else:
        complete = "never complete" if stop_s is None else f"complete at {stop_s:.1f} s"
        state = f"ready at {start_s:.1f} s, {complete}"
    return f"{state}, from {texture.get('samples', 0)} samples"


def _errors(evaluation: Mapping[str, Any]) -> Iterator[str]:
    sessions = evaluation.get("sessions") or ([evaluation] if evaluation else [])
    for each in sessions:
        score = each.get("at_stop") or each["at_end"]
        power_db, share = score["power_error_db"], score["within_jnd"]
        if power_db is None or share is None:
            continue
        name = f"{each['session']}: " if len(sessions) > 1 else ""
        where = "the held-out segments"
        if each["basis"] == "truth":
            plane = f"{100 * score['plane_within_jnd']:.0f} % of the whole plane"
            against = each.get("basis_reason", "the known texture")
            where = f"the strokes made and {plane}, against {against}"
        yield f"{name}{power_db:.1f} dB, within one JND on {100 * share:.0f} % of {where}"
        skin = each.get("at_skin")
        if skin is not None:
            yield (
                f"{name}{skin['power_error_db']:.1f} dB at the skin: the actuator plays "
                f"{100 * skin['played_share']:.0f} % of the power"
            )


def _next(recording: str | None, report: Path | None, *, whole: bool) -> str:
    steps = []
    if report is not None:
        steps.append(f"open {report}")
    if recording is not None:
        shows = f"mmt session view {recording} shows each moment"
        steps.append(shows if whole else f"mmt session recover {recording} saves what was written")
    return "; ".join([*steps, "--verbose shows all counters"])
