"""What a person does on the monitor's page; each order is answered by a sentence."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.leader.journal import Journal
from mmt.web.binary_messages import pack
from mmt.web.monitor.states import model_of

if TYPE_CHECKING:
    from mmt.leader.service import LeaderService
    from mmt.session.recorder import McapRecorder

_LONGEST_MARK: Final = 200
_FOLDER: Final = Path("mmt-monitor")
"""Where files go in a scene that names no recording."""

MODES: Final = ("auto", "streamed", "synthesized")


class Controls:
    """Carry out orders, one after the other.

    Parameters
    ----------
    service
        What is controlled.
    journal
        Is told of everything, and so the recording.
    """

    def __init__(self, service: "LeaderService", journal: Journal) -> None:
        self._service = service
        self._journal = journal
        self._one = asyncio.Lock()
        self._orders: dict[str, Callable[[dict[str, Any]], Awaitable[str]]] = {
            "mark": self._mark,
            "reset": self._reset,
            "freeze": self._freeze,
            "mode": self._mode,
            "record": self._record,
            "save": self._save,
        }

    def state(self) -> dict[str, Any]:
        """Return what the controls stand at, and which of them this scene has."""
        service, parts = self._service, self._service.parts
        recorder, modelling = parts.recorder, parts.modelling
        return {
            "recording": recorder.path.name if recorder is not None else None,
            "records": bool(service.scene.channels()),
            "models": modelling is not None,
            "frozen": modelling is not None and modelling.frozen,
            "renders": parts.synthesizer is not None,
            "forced": service.models.forced or "auto",
            "network": service.scene.network is not None,
        }

    async def answer(self, text: str) -> tuple[str, bytes]:
        """Carry out an order, JSON text with ``id`` and ``do``; return the answer with its kind.

        Whatever comes is answered, also if it makes no sense.
        """
        number, good = 0, False
        try:
            order = _parse(text)
            number = order["id"]
            async with self._one:
                sentence = await self._orders[order["do"]](order)
            good = True
        except MmtError as error:
            sentence = str(error)
        except OSError as error:
            sentence = error.strerror or str(error)
        header = {"id": number, "ok": good, "text": sentence}
        # the kinds are few, so that who sends orders and reads no answers fills no memory
        return f"answer {number % 16}", pack("answer", header, {})

    # --- the orders

    async def _mark(self, order: dict[str, Any]) -> str:
        text = order.get("text", "")
        if (
            not isinstance(text, str)
            or len(text) > _LONGEST_MARK
            or not (text or "x").isprintable()
        ):
            raise InputError(f"a mark is a line of {_LONGEST_MARK} characters at most")
        name = text.strip() or "mark"
        self._journal.event(f"marked: {name}", mark=name)
        recorded = self._service.parts.recorder is not None
        return f"marked: {name}" + ("" if recorded else " (nothing is being recorded)")

    async def _reset(self, _: dict[str, Any]) -> str:
        self._modelling()
        self._service.reset_model()
        return "the model begins anew"

    async def _freeze(self, order: dict[str, Any]) -> str:
        modelling, wanted = self._modelling(), _flag(order)
        if modelling.frozen != wanted:
            modelling.freeze(wanted)
            self._journal.event("model frozen" if wanted else "model grows again", frozen=wanted)
        return "the model stays as it is" if wanted else "the model grows"

    async def _mode(self, order: dict[str, Any]) -> str:
        mode = order.get("mode")
        if mode not in MODES:
            raise InputError(f"mode is {mode!r}: allowed are {', '.join(MODES)}")
        self._service.models.force(None if mode == "auto" else mode)
        sentence = {
            "auto": "the model takes over by its start criterion",
            "streamed": "held to streamed vibration",
            "synthesized": "held to the model's vibration",
        }[mode]
        self._journal.event(sentence, forced=mode)
        return sentence

    async def _record(self, order: dict[str, Any]) -> str:
        parts, wanted = self._service.parts, _flag(order)
        if wanted == (parts.recorder is not None):
            raise InputError("a recording runs already" if wanted else "no recording runs")
        if not wanted:
            return await self._end_recording()
        path = self._free("", ".mcap")
        begins_s = self._service.time_s
        recorder = await asyncio.to_thread(_recorder, self._service, path, begins_s)
        if self._service.ending.reached:
            await asyncio.to_thread(recorder.close)
            raise MmtError("the session has ended")
        parts.recorder = recorder
        self._journal.event(f"recording into {path}")
        return f"recording into {path}"

    async def _end_recording(self) -> str:
        parts = self._service.parts
        recorder = parts.recorder
        assert recorder is not None  # noqa: S101 - the caller has looked
        self._service.models.record_last()
        self._journal.event(f"recording of {recorder.path} ended")
        parts.recorder, parts.ended_recorder = None, recorder
        await asyncio.to_thread(recorder.close)
        if recorder.error is not None:
            raise MmtError(f"recording {recorder.path}: {recorder.error}")
        return f"recorded {recorder.frames} frames into {recorder.path}"

    async def _save(self, _: dict[str, Any]) -> str:
        model = model_of(self._service)
        if model is None:
            raise InputError("there is no model yet: stroke the surface first")
        path = self._free("-model", ".npz")
        await asyncio.to_thread(_write, path, model.to_bytes)
        self._journal.event(f"model saved as {path}")
        return f"saved {len(model.points)} samples as {path}"

    # ---

    def _modelling(self) -> Any:
        modelling = self._service.parts.modelling
        if modelling is None:
            raise InputError("this scene builds no model: it has no [texture]")
        return modelling

    def _free(self, what: str, suffix: str) -> Path:
        """Return a path beside the scene's recording at which there is no file."""
        scene = self._service.scene
        recording = scene.recording
        base = recording.file if recording is not None else _FOLDER / scene.session.name
        stem = base.stem if recording is not None else base.name
        number = 1
        while (path := base.with_name(f"{stem}{what}-{number}{suffix}")).exists():
            number += 1
        return path


def _recorder(service: "LeaderService", path: Path, begins_s: float) -> "McapRecorder":
    from mmt.session.recorder import McapRecorder

    scene = service.scene
    return McapRecorder(
        path,
        channels=scene.channels(),
        scene=scene.dump(),
        session_id=service.log.session_id,
        begins_s=begins_s,
    )


def _write(path: Path, content: Callable[[], bytes]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as stream:
        stream.write(content())


def _parse(text: str) -> dict[str, Any]:
    try:
        order = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"an order is a JSON object: {error}") from error
    if not isinstance(order, dict):
        raise InputError("an order is a JSON object")
    number, what = order.get("id"), order.get("do")
    if not isinstance(number, int) or not 0 <= number < 2**31:
        raise InputError("id of an order is a number from 0")
    known = ("mark", "reset", "freeze", "mode", "record", "save")
    if what not in known:
        raise InputError(f"do is {what!r}: allowed are {', '.join(known)}")
    return order


def _flag(order: dict[str, Any]) -> bool:
    wanted = order.get("on")
    if not isinstance(wanted, bool):
        raise InputError(f"on is {wanted!r}: allowed are true and false")
    return wanted
