"""The part that renders a model shared by another machine's leader."""

import asyncio
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any

from mmt.core.errors import FAILED
from mmt.leader.part import Part, Session
from mmt_share.client import ListenerClient
from mmt_share.tables import Listening, Operating

if TYPE_CHECKING:
    from mmt.leader.building import LeaderParts
    from mmt.leader.output.model_output import ModelOutput
    from mmt_share.parts.operating import OperatingPart


class ListeningPart(Part):
    """Keep a copy of the shared model, and render from each new state of it.

    Parameters
    ----------
    session
        Session of the run.
    table
        The scene's ``[listening]``.
    completing
        Renders the model.
    operating
        Asks for control, if the scene's hand may have it.

    Raises
    ------
    InputError
        The URL, the token or a certificate cannot be used.
    """

    def __init__(
        self,
        session: Session,
        table: Listening,
        completing: "ModelOutput",
        operating: "OperatingPart | None",
    ) -> None:
        self._session, self._completing = session, completing
        self._url = table.url
        self.client = ListenerClient(
            table,
            on_event=session.journal.event,
            operator=None if operating is None else operating.client,
        )
        self.first_s: float | None = None
        """Seconds from the start to the first model that was ready."""

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "ListeningPart | None":
        """Return the part, or None if the scene has no ``[listening]``."""
        table = session.scene.table(Listening)
        if table is None:
            return None
        operating = None
        if session.scene.table(Operating) is not None:
            from mmt_share.parts.operating import OperatingPart

            operating = parts.get(OperatingPart)
        return cls(session, table, parts.completing, operating)

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the task that listens."""
        return {"listening": self._run()}

    async def finish(self) -> None:
        """Mark the session as failed if it has run its full time and never reached a leader."""
        ending = self._session.ending
        if ending.outcome == "completed" and not self.client.session:
            ending.outcome = f"{FAILED}no leader was heard at {self._url}: start one with --share"

    async def stop(self) -> None:
        """Disconnect from the leader."""
        await self.client.close()

    def faults(self) -> list[str]:
        """Return a sentence if the leader is not connected."""
        return [] if self.client.connected else ["the leader that shares the model is not there"]

    def status(self) -> dict[str, Any]:
        """Return the model's number of samples and its progress."""
        about = self.client.replica.about
        return {} if about is None else {"samples": about.samples, "completion": about.completion}

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return how much was received."""
        client = self.client
        return {
            "listening": {
                "session_id": client.session.get("session_id"),
                "number": client.replica.number,
                "whole_models": client.wholes,
                "changes": client.changes,
                "states": client.states,
                "rejected": client.rejected,
                "first_model_s": self.first_s,
            }
        }

    async def _run(self) -> None:
        """Connect, and render from each new state of the model until cancelled.

        Raises
        ------
        MmtError
            Nobody shares a model there, or the listener was refused.
        """
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        await self.client.connect()
        while True:
            about, model = await self.client.next_state()
            if model is None:
                self._completing.withhold_model()
                continue
            await self._completing.use_shared(model, about.surface)
            if self.first_s is None:
                self.first_s = round(loop.time() - begun_s, 3)
                self._session.journal.event(
                    f"rendering the shared model, {about.samples} samples, after {self.first_s} s"
                )
