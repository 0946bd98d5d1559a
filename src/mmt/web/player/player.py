"""The player: textures, the page, the scenario and the recording; one page at a time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from aiohttp import web

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.link.access import TOKEN_VARIABLE, Access, check_listening
from mmt.link.http import Listener
from mmt.texture.model.texture_model import TextureModel
from mmt.web.binary_messages import pack
from mmt.web.page_server import add_page, open_socket, player_files, refuse_strangers
from mmt.web.player.motion import PointerMotion
from mmt.web.player.pictures import picture
from mmt.web.player.recording import TouchRecorder
from mmt.web.player.results import ResultsFile
from mmt.web.player.study import BEST, MOST_TILES, SCENARIOS, Study
from mmt.web.player.visit import Visit

TAKEN_OVER: Final = 4409
"""Close code: another page plays now."""
FULL_SCALE_M_S2: Final = 30.0
"""What the page turns into a sound card's full scale, at full volume."""
_MOST_BYTES: Final = 32_768
_REMEDY: Final = f"set a token ({TOKEN_VARIABLE} or --token-file), or allow everyone by --open"


class Player:
    """Serve the page ``/player/``.

    Parameters
    ----------
    names, models
        The textures, 1 to 26.
    results
        Where the scenarios' rows go.
    record
        File of the sessions, None records nothing.
    seed
        Of orders and excitation.
    access
        What is asked of a page.

    Raises
    ------
    InputError
        There are too many textures, or none.
    """

    def __init__(
        self,
        names: Sequence[str],
        models: Sequence[TextureModel],
        *,
        results: ResultsFile,
        record: Path | None = None,
        seed: int = 0,
        access: Access | None = None,
    ) -> None:
        if not 1 <= len(models) <= MOST_TILES:
            raise InputError(f"{len(models)} textures: allowed are 1 to {MOST_TILES}")
        self.names = tuple(names)
        self.models = tuple(models)
        self.seed = seed
        self.study: Study | None = None
        self.results = results
        self._access = access or Access()
        self._recorder = None
        if record is not None:
            rate_hz = max(model.rate_hz for model in models)
            self._recorder = TouchRecorder(record, names, models, rate_hz)
        self._pictures = np.stack([picture(model, number) for number, model in enumerate(models)])
        self._visit: Visit | None = None
        self._host = ""
        application = web.Application()
        application.router.add_get("/", self._redirect)
        application.router.add_get("/player/socket", self._receive)
        add_page(application, "/player", player_files())
        self._listener = Listener(application, "--host and --port")

    @property
    def port(self) -> int:
        """The port that is listened on, 0 before `start`."""
        return self._listener.port

    async def start(self, host: str, port: int, *, everyone: bool = False) -> None:
        """Listen.

        Parameters
        ----------
        host, port
            Where; port 0 takes any free one.
        everyone
            Whether strangers may play.

        Raises
        ------
        InputError
            Strangers could play although they may not, or a certificate cannot be used.
        MmtError
            The host or the port cannot be had.
        """
        check_listening(
            host, port, self._access, allowed=everyone, whom="the player", remedy=_REMEDY
        )
        self._host = host
        await self._listener.start(host, port, self._access, allowed=True)

    async def stop(self) -> list[tuple[Path, float]]:
        """Stop listening, and end recordings; return each with its seconds."""
        if self._visit is not None:
            await self._visit.socket.close()
        await self._listener.stop()
        recorded = [] if self._recorder is None else self._recorder.close()
        self.leave()
        return recorded

    def hello(self) -> bytes:
        """Return what a page needs to know at first."""
        header = {"names": self.names, "full_scale_m_s2": FULL_SCALE_M_S2, "best": BEST}
        return pack("hello", header, {"pictures": self._pictures})

    @property
    def recording_problem(self) -> str | None:
        """Why nothing is recorded any more, None while all is well."""
        return None if self._recorder is None else self._recorder.problem

    def status(self) -> dict[str, object]:
        """Return how recording and results stand."""
        recorder = self._recorder
        return {
            "recorded_s": None if recorder is None else round(recorder.seconds, 1),
            "problem": self.recording_problem,
            "rows": self.results.rows,
        }

    def texture(self, tile: int) -> int | None:
        """Return the texture under a tile, None where it is not to be felt now."""
        return tile if self.study is None else self.study.texture(tile)

    def record(self, texture: int, motion: PointerMotion, vibration_m_s2: FloatArray) -> None:
        """Record a touch, where something is recorded."""
        if self._recorder is not None and len(vibration_m_s2):
            self._recorder.record(texture, motion, vibration_m_s2)

    def lift(self) -> None:
        """Note that nothing is touched."""
        if self._recorder is not None:
            self._recorder.lift()

    def begin(self, scenario: str, participant: str) -> str:
        """Begin a scenario; return a sentence.

        Raises
        ------
        InputError
            There is none of this name.
        MmtError
            The results cannot be written.
        """
        if scenario not in SCENARIOS:
            raise InputError(f"scenario {scenario}: allowed are {', '.join(SCENARIOS)}")
        self.leave()
        self.study = SCENARIOS[scenario](self.names, participant, self.seed, self.results.write)
        return f"{scenario} of {participant} begins"

    def leave(self) -> str:
        """End the scenario, if one runs; return a sentence."""
        study, self.study = self.study, None
        if study is not None:
            study.leave()
        return "all textures may be felt"

    async def _redirect(self, _: web.Request) -> web.StreamResponse:
        raise web.HTTPFound("/player/")

    async def _receive(self, request: web.Request) -> web.StreamResponse:
        refuse_strangers(request, self._access, self._host)
        socket, admitted = await open_socket(request, self._access, _MOST_BYTES)
        if not admitted:
            return socket
        visit, earlier = Visit(self, socket), self._visit
        self._visit = visit
        if earlier is not None:
            await earlier.socket.close(code=TAKEN_OVER, message=b"another page plays now")
        try:
            await visit.serve()
        finally:
            if self._visit is visit:
                self._visit = None
        return socket
