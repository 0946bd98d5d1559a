"""Verdict on a run that has ended, from its services' summaries and its evaluation."""

from collections.abc import Iterable, Iterator, Mapping
from statistics import median
from typing import Any, Final, NamedTuple

from mmt.core.verdict import LATE_SHARE, Facts, Verdict, has_failed, verdict
from mmt.texture.settings import JND_DB


class _Fault(NamedTuple):
    """A counter that stays 0 in a run where all is well."""

    path: str
    """Path of the counter in a summary; ``*`` stands for each table there."""
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
    _Fault("backfill.gone", "frame", "frames", "asked for again, but never made or no longer kept"),
    _Fault("texture.dropped_frames", "frame", "frames", "not modelled: the model was too slow"),
    _Fault("texture.late_frames", "frame", "frames", "too late for the model"),
    _Fault("texture.tasks.*.drops", "item", "items", "dropped before {name}: it was too slow"),
    _Fault("generator.late_blocks", "block", "blocks", "of the generator too late to be rendered"),
    _Fault("vibration.playout.resyncs", "restart of the playout", "restarts of the playout"),
    _Fault("vibration.actuator.clipped", "sample", "samples", "clipped at the actuator's limit"),
    _Fault("recording.dropped", "frame", "frames", "not recorded: the disk was too slow"),
    _Fault("commands.silences", "silence of the leader", "silences of the leader"),
    _Fault("commands.implausible_commands", "command", "commands", "with an impossible echo"),
    _Fault("commands.stale_commands", "command", "commands", "too old on arrival"),
    _Fault("commands.clipped_commands", "command", "commands", "outside the workspace"),
    _Fault("commands.halts", "halt of the robot", "halts of the robot"),
    _Fault("handle.losses", "loss of the handle", "losses of the handle"),
    _Fault("handle.faults", "fault of the handle", "faults of the handle"),
    _Fault("devices.*.losses", "loss of the {name}", "losses of the {name}"),
    _Fault(
        "devices.*.missed_frames",
        "frame without a reading of the {name}",
        "frames without a reading of the {name}",
    ),
    _Fault("devices.*.faults", "fault of the {name}", "faults of the {name}"),
    _Fault("devices.*.clock_jumps", "jump of the {name}'s clock", "jumps of the {name}'s clock"),
)

_NOT_MEASURED: Final = "not measured: "


def run_verdict(
    summaries: Mapping[str, Mapping[str, Any]], evaluation: Mapping[str, Any] | None = None
) -> Verdict:
    """Return the verdict on a run that has ended.

    Parameters
    ----------
    summaries
        Summaries of the leader, the follower, or both, by these names, in the form of ``--json``;
        empty if only a session was evaluated.
    evaluation
        Evaluation of the recording, or of several sessions (then by medians), in the form of
        ``--json``; None or empty if nothing was evaluated.
    """
    leader = summaries.get("leader", {})
    main = leader or summaries.get("follower", {})
    evaluation = evaluation or {}
    sessions = evaluation.get("sessions", [evaluation] if evaluation else [])
    scores = [final_of(each) for each in sessions]
    texture = leader.get("texture") or {}
    timed = texture or {
        key: median_of_most(each.get(key) for each in sessions) for key in ("start_s", "stop_s")
    }
    readiness, completion = _completion(texture, sessions)
    recording = leader.get("recording", {})
    outcome = main.get("outcome", "completed")
    if recording.get("error") and not has_failed(outcome):
        outcome = f"failed: recording {recording['file']}: {recording['error']}"
    return verdict(
        Facts(
            time_s=main.get("session", {}).get("duration_s"),
            mode=leader.get("vibration", {}).get("mode"),
            start_s=timed.get("start_s"),
            stop_s=timed.get("stop_s"),
            outcome=outcome,
            models=bool(texture or sessions),
            readiness=readiness,
            completion=completion,
            error_db=median_of_known(score.get("power_error_db") for score in scores),
            skin_error_db=median_of_known(
                (each.get("at_skin") or {}).get("power_error_db") for each in sessions
            ),
            jnd_db=JND_DB,
            faults=_run_faults(summaries, sessions),
        )
    )


def _run_faults(
    summaries: Mapping[str, Mapping[str, Any]], sessions: Iterable[Mapping[str, Any]]
) -> list[str]:
    """Return a sentence for each fault of the services, and of the signals of the sessions."""
    texts = {each.get("faults", {}).get("text") for each in sessions}
    of_signals = sorted(f"{_NOT_MEASURED}{text}" for text in texts if text)
    found = [told for name, table in summaries.items() for told in fault_sentences(name, table)]
    if of_signals:  # those of the leader end earlier
        found = [sentence for sentence in found if _NOT_MEASURED not in sentence]
    return found + of_signals


def fault_sentences(name: str, summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each fault in a service's summary."""
    filled = "filled" in summary.get("backfill", {})
    told = {"link.lost"} if filled else set()  # `backfill.lost` tells of those never filled in
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
        found.append(f"{_NOT_MEASURED}{signal_faults}")
    if generator_fault := summary.get("generator", {}).get("fault"):
        found.append(f"{generator_fault}; our model was rendered in its place")
    late = summary.get("ticks", {}).get("late_share_1ms") or 0.0
    if late > LATE_SHARE:
        found.append(f"{late:.0%} of the ticks over 1 ms late".replace("%", " %"))
    if error:
        found.append(f"the recording failed: {error}; {recording['dropped']} frames are not in it")
    who = "listener" if "listening" in summary else name  # which runs as a leader does
    return [f"{who}: {sentence}" for sentence in found]


def _values(
    table: Mapping[str, Any], path: list[str], place: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield the values at a path, with the name of the table that stood for ``*``."""
    first, *rest = path
    names = list(table) if first == "*" else [first]
    for name in names:
        value = table.get(name)
        place_here = str(name).replace("_", " ") if first == "*" else place
        if not rest and isinstance(value, Mapping):
            yield place_here, {kind: count for kind, count in value.items() if count}
        elif not rest:
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


def _completion(
    texture: Mapping[str, Any], sessions: list[Mapping[str, Any]]
) -> tuple[float | None, str]:
    """Return the readiness, or words with the value of another criterion."""
    if progress := texture.get("completion"):
        known = [(progress.get("criterion"), progress.get("value"))]
    else:
        known = [
            (_criterion(each.get("method", "")), final_of(each).get("completion"))
            for each in sessions
        ]
    values = [value for name, value in known if name == "uncertainty" and value is not None]
    if values:
        return median(values), ""
    sums = [value for _, value in known if value is not None]
    return None, f"completion sum {median(sums):.1f}" if sums else ""


def _criterion(method: str) -> str:
    return "distance" if method == "published" else "uncertainty"


def final_of(session: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the last score of an evaluated session, as ``--json`` has it; empty if it has none."""
    return session.get("at_stop") or session.get("at_end") or {}


def median_of_known(values: Iterable[float | None]) -> float | None:
    """Return the median of the values that are not None, or None if all are."""
    known = [value for value in values if value is not None]
    return median(known) if known else None


def median_of_most(values: Iterable[float | None]) -> float | None:
    """Return the median over sessions; None if most have no value, such as a time never reached."""
    every = list(values)
    return median_of_known(every) if 2 * every.count(None) < len(every) else None
