"""Carry out orders from the monitor's page; each order is answered with a sentence."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import write_file
from mmt.leader.part import Session
from mmt.web.page_server import pack

if TYPE_CHECKING:
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.output.model_output import ModelOutput
    from mmt.leader.recording import RecordingPart
    from mmt.texture.model.texture_model import TextureModel

_LONGEST_MARK: Final = 200
_FOLDER: Final = Path("mmt-monitor")
"""Folder for files if the scene has no ``[recording]``."""

MODES: Final = ("auto", "streamed", "synthesized")


class Controls:
    """Carries out orders, one after the other; they become events of the session, thus recorded.

    Parameters
    ----------
    session
        Session of the run.
    completing, recording, modelling
        Parts on which the orders act.
    """

    def __init__(
        self,
        session: Session,
        completing: "ModelOutput",
        recording: "RecordingPart",
        modelling: "Modelling | None",
    ) -> None:
        self._session, self._completing = session, completing
        self._recording, self._modelling = recording, modelling
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

    @property
    def model(self) -> "TextureModel | None":
        """The model being built; before the first update the saved model, if any."""
        log = self._session.log
        if log.update is not None:
            return log.update.model
        return None if log.update_times.count else self._completing.rendered

    @property
    def surfaces(self) -> tuple[int, list[int]] | None:
        """The number of the surface under the tool, and the numbers of all known surfaces.

        None if surfaces are not distinguished, or before the first update.
        """
        found = self._session.log.surfaces
        return None if found is None else (found.current, sorted(found.entries))

    def state(self) -> dict[str, Any]:
        """Return the state of the controls, and which of them this scene has."""
        scene, completing, modelling = self._session.scene, self._completing, self._modelling
        running = self._recording.running
        return {
            "recording": None if running is None else running.path.name,
            "records": bool(scene.channels()),
            "models": modelling is not None,
            "saves": self.model is not None,
            "frozen": modelling is not None and modelling.frozen,
            "renders": completing.renders,
            "forced": completing.forced or "auto",
            "surfaces": self.surfaces,
            "network": scene.network is not None,
        }

    async def answer(self, text: str) -> tuple[str, bytes]:
        """Carry out an order, JSON text with ``id`` and ``do``; return kind and answer.

        Invalid orders are answered too.
        """
        number, good = 0, False
        try:
            verbs = self._session.parts.verbs("orders")
            others = {name: order for orders in verbs for name, order in orders().items()}
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
            raise InputError(f"a mark is a line of {_LONGEST_MARK} printable characters at most")
        name = text.strip() or "mark"
        self._event(f"marked: {name}", mark=name)
        recorded = self._recording.running is not None
        return f"marked: {name}" + ("" if recorded else " (nothing is being recorded)")

    async def _reset(self, _: dict[str, Any]) -> str:
        self._modelled()
        self._completing.reset()
        return "the model begins anew"

    async def _freeze(self, order: dict[str, Any]) -> str:
        modelling, wanted = self._modelled(), _flag(order)
        if modelling.frozen != wanted:
            modelling.freeze(wanted)
            self._event("model frozen" if wanted else "model grows again", frozen=wanted)
        return "the model stays as it is" if wanted else "the model grows"

    async def _surface(self, order: dict[str, Any]) -> str:
        if self.surfaces is None:
            raise InputError("this scene tells no surfaces apart, or there is no model yet")
        now, known = self.surfaces
        surface = order.get("surface")
        if surface is None:
            surface = max(known) + 1
        elif surface not in known or not isinstance(surface, int):
            numbers = ", ".join(map(str, known))
            raise InputError(f"surface is {surface!r}: known are {numbers}; null (new) is another")
        if surface == now:
            return f"surface {now} it is"
        self._modelled().state_surface(surface)
        return f"surface {surface} again" if surface in known else f"a new surface, {surface}"

    async def _mode(self, order: dict[str, Any]) -> str:
        mode = order.get("mode")
        if mode not in MODES:
            raise InputError(f"mode is {mode!r}: allowed are {', '.join(MODES)}")
        self._completing.force(None if mode == "auto" else mode)
        sentence = {
            "auto": "the model takes over by its start criterion",
            "streamed": "held to streamed vibration",
            "synthesized": "held to the model's vibration",
        }[mode]
        self._event(sentence, forced=mode)
        return sentence

    async def _record(self, order: dict[str, Any]) -> str:
        if _flag(order):
            if self._recording.running is not None:
                raise InputError("a recording runs already")
            path = self._free("", ".mcap")
            await self._recording.start(path)
            return f"recording into {path}"
        ended = await self._recording.end()
        return f"recorded {ended.frames} frames into {ended.path}"

    async def _save(self, _: dict[str, Any]) -> str:
        model = self.model
        if model is None:
            raise InputError("there is no model yet: stroke the surface first")
        path = self._free("-model", ".npz")
        await asyncio.to_thread(lambda: write_file(path, model.to_bytes()))
        self._event(f"model saved as {path}")
        return f"saved {len(model.points)} samples as {path}"

    # ---

    def _event(self, sentence: str, **details: object) -> None:
        self._session.journal.event(sentence, **details)

    def _modelled(self) -> "Modelling":
        if self._modelling is None:
            raise InputError("this scene builds no model: it has no [texture]")
        return self._modelling

    def _free(self, what: str, suffix: str) -> Path:
        """Return a path beside the scene's recording that does not exist yet."""
        scene = self._session.scene
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
