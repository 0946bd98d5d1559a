"""Carry out orders from the monitor's page; each order is answered with a sentence."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.core.existing_files import write_file
from mmt.web.binary_messages import pack
from mmt.web.monitor.view import LeaderView

_LONGEST_MARK: Final = 200
_FOLDER: Final = Path("mmt-monitor")
"""Folder for files if the scene has no ``[recording]``."""

MODES: Final = ("auto", "streamed", "synthesized")


class Controls:
    """Carries out orders, one after the other.

    Parameters
    ----------
    leader
        The leader to control; orders become events of the session, and so are recorded.
    """

    def __init__(self, leader: LeaderView) -> None:
        self._leader = leader
        self._one = asyncio.Lock()
        self._orders: dict[str, Callable[[dict[str, Any]], Awaitable[str]]] = {
            "mark": self._mark,
            "reset": self._reset,
            "freeze": self._freeze,
            "surface": self._surface,
            "mode": self._mode,
            "record": self._record,
            "save": self._save,
        }

    def state(self) -> dict[str, Any]:
        """Return the state of the controls, and which of them this scene has."""
        leader = self._leader
        recording = leader.recording
        return {
            "recording": recording.name if recording is not None else None,
            "records": bool(leader.scene.channels()),
            "models": leader.frozen is not None,
            "saves": leader.model is not None,
            "frozen": bool(leader.frozen),
            "renders": leader.renders,
            "forced": leader.forced or "auto",
            "surfaces": leader.surfaces,
            "network": leader.scene.network is not None,
        }

    async def answer(self, text: str) -> tuple[str, bytes]:
        """Carry out an order, JSON text with ``id`` and ``do``; return kind and answer.

        Invalid orders are answered too.
        """
        number, good = 0, False
        try:
            others = self._leader.orders
            order = _parse(text, [*self._orders, *others])
            number, what = order["id"], order["do"]
            async with self._one:
                own = self._orders.get(what)
                sentence = others[what](order) if own is None else await own(order)
            good = True
        except MmtError as error:
            sentence = str(error)
        except OSError as error:
            sentence = error.strerror or str(error)
        header = {"id": number, "ok": good, "text": sentence}
        # only 16 kinds, so that a client that reads no answers cannot fill the memory
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
        self._leader.log_event(f"marked: {name}", mark=name)
        recorded = self._leader.recording is not None
        return f"marked: {name}" + ("" if recorded else " (nothing is being recorded)")

    async def _reset(self, _: dict[str, Any]) -> str:
        self._require_modelling()
        self._leader.reset_model()
        return "the model begins anew"

    async def _freeze(self, order: dict[str, Any]) -> str:
        self._require_modelling()
        wanted = _flag(order)
        if self._leader.frozen != wanted:
            self._leader.freeze(wanted)
            self._leader.log_event("model frozen" if wanted else "model grows again", frozen=wanted)
        return "the model stays as it is" if wanted else "the model grows"

    async def _surface(self, order: dict[str, Any]) -> str:
        if self._leader.surfaces is None:
            raise InputError("this scene tells no surfaces apart, or there is no model yet")
        now, known = self._leader.surfaces
        surface = order.get("surface")
        if surface is None:
            surface = max(known) + 1
        elif surface not in known or not isinstance(surface, int):
            numbers = ", ".join(map(str, known))
            raise InputError(f"surface is {surface!r}: known are {numbers}, null is another one")
        if surface == now:
            return f"surface {now} it is"
        self._leader.state_surface(surface)
        return f"surface {surface} again" if surface in known else f"a new surface, {surface}"

    async def _mode(self, order: dict[str, Any]) -> str:
        mode = order.get("mode")
        if mode not in MODES:
            raise InputError(f"mode is {mode!r}: allowed are {', '.join(MODES)}")
        self._leader.force(None if mode == "auto" else mode)
        sentence = {
            "auto": "the model takes over by its start criterion",
            "streamed": "held to streamed vibration",
            "synthesized": "held to the model's vibration",
        }[mode]
        self._leader.log_event(sentence, forced=mode)
        return sentence

    async def _record(self, order: dict[str, Any]) -> str:
        if _flag(order):
            if self._leader.recording is not None:
                raise InputError("a recording runs already")
            path = self._free("", ".mcap")
            await self._leader.start_recording(path)
            return f"recording into {path}"
        path, frames = await self._leader.end_recording()
        return f"recorded {frames} frames into {path}"

    async def _save(self, _: dict[str, Any]) -> str:
        model = self._leader.model
        if model is None:
            raise InputError("there is no model yet: stroke the surface first")
        path = self._free("-model", ".npz")
        await asyncio.to_thread(lambda: write_file(path, model.to_bytes()))
        self._leader.log_event(f"model saved as {path}")
        return f"saved {len(model.points)} samples as {path}"

    # ---

    def _require_modelling(self) -> None:
        if self._leader.frozen is None:
            raise InputError("this scene builds no model: it has no [texture]")

    def _free(self, what: str, suffix: str) -> Path:
        """Return a path beside the scene's recording that does not exist yet."""
        scene = self._leader.scene
        recording = scene.recording
        base = recording.file if recording is not None else _FOLDER / scene.session.name
        stem = base.stem if recording is not None else base.name
        number = 1
        while (path := base.with_name(f"{stem}{what}-{number}{suffix}")).exists():
            number += 1
        return path


def _parse(text: str, known: list[str]) -> dict[str, Any]:
    try:
        order = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"an order is a JSON object: {error}") from error
    if not isinstance(order, dict):
        raise InputError("an order is a JSON object")
    number, what = order.get("id"), order.get("do")
    if not isinstance(number, int) or not 0 <= number < 2**31:
        raise InputError("id of an order is a number from 0")
    if what not in known:
        raise InputError(f"do is {what!r}: allowed are {', '.join(known)}")
    return order


def _flag(order: dict[str, Any]) -> bool:
    wanted = order.get("on")
    if not isinstance(wanted, bool):
        raise InputError(f"on is {wanted!r}: allowed are true and false")
    return wanted
