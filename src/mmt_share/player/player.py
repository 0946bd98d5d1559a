"""The texture player: textures with their pictures, the running scenario, the recording."""

import math
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.model.json_form import model_json
from mmt.texture.model.texture_model import TextureModel
from mmt.web.page_server import pack
from mmt_share.player.messages import Step
from mmt_share.player.recording import TouchRecorder
from mmt_share.player.results import ResultsFile
from mmt_share.player.study import BEST, MOST_TILES, SCENARIOS, Study

_SLOWEST_STROKE_MM_S: Final = 5.0

SIZE: Final = 96
"""Pixels along each edge of a picture."""
_WIDTH_MM: Final = 24.0
_SPEED_MM_S: Final = 100.0
_FORCE_N: Final = 1.0
_HEADINGS: Final = 72
_LONGEST_MM: Final = 8.0


class Player:
    """Textures that a page plays, at most one running scenario, and the recording of touches.

    Parameters
    ----------
    names
        Names of the textures, 1 to 26.
    models
        Their models; empty for a shared surface that has no model yet.
    results
        Receives the scenarios' rows.
    record
        File of the sessions; None records nothing.
    replace
        Whether to replace recordings that exist.
    seed
        Seed of the scenarios' orders and of the excitation.
    scenarios
        Whether scenarios may be begun.

    Raises
    ------
    InputError
        There are too many textures, or none, or a page cannot render one of them.

    Attributes
    ----------
    model_messages
        Messages to a page: each texture with its picture.
    hand
        Hand on a shared surface: x and y (mm), and whether it touches; None if there is none.
    ordering
        Held while an order to a scenario is carried out: one at a time, from all pages.
    said
        Newest event of a shared surface.
    completion
        Progress of a shared surface's model, in words; "" before it is known.
    """

    def __init__(
        self,
        names: Sequence[str],
        models: Sequence[TextureModel],
        *,
        results: ResultsFile,
        record: str | Path | None = None,
        replace: bool = False,
        seed: int = 0,
        scenarios: bool = True,
    ) -> None:
        if not 1 <= len(names) <= MOST_TILES:
            raise InputError(f"{len(names)} textures: allowed are 1 to {MOST_TILES}")
        self.names = tuple(names)
        self._seed = seed
        self._scenarios = scenarios
        self.study: Study | None = None
        self.results = results
        self.ordering = threading.Lock()
        self._recorder = None
        if record is not None:
            self._recorder = TouchRecorder(record, names, models, seed=seed, replace=replace)
        self.hand: tuple[float, float, bool] | None = None
        self.said = self.completion = ""
        self.set_models(models)

    def close(self) -> list[tuple[Path, float]]:
        """End the scenario and the recordings; return each recording with its duration in s."""
        recorded = [] if self._recorder is None else self._recorder.close()
        with self.ordering:
            self.end_scenario()
        return recorded

    def set_models(self, models: Sequence[TextureModel]) -> None:
        """Replace the models of the textures.

        Raises
        ------
        InputError
            A page cannot render one of them; all stay as they were.
        """
        self.model_messages = tuple(
            pack(
                "model",
                {"texture": number, "form": model_json(model, name)},
                {"picture": picture(model, number)},
            )
            for number, (name, model) in enumerate(zip(self.names, models, strict=False))
        )

    def hello(self) -> bytes:
        """Return the first message to a page."""
        header = {
            "names": self.names,
            "best": BEST,
            "scenarios": self._scenarios,
            "records": self._recorder is not None,
        }
        return pack("hello", header, {})

    @property
    def recording_problem(self) -> str | None:
        """Why recording stopped, or None if it did not."""
        return None if self._recorder is None else self._recorder.problem

    def status(self) -> dict[str, object]:
        """Return the status of recording, results and a shared surface."""
        recorder = self._recorder
        return {
            "recorded_s": None if recorder is None else round(recorder.seconds, 1),
            "problem": self.recording_problem,
            "rows": self.results.rows,
            "said": self.said,
            "completion": self.completion,
        }

    def stroke(self, tile: int, steps: Sequence[Step]) -> None:
        """Take a part of a stroke over a tile: it counts for the scenario, and is recorded."""
        texture = tile if self.study is None else self.study.texture(tile)
        if texture is None:
            self.end_touch()
            return
        if self.study is not None:
            moved = (s for s in steps if math.hypot(s.x_mm_s, s.y_mm_s) >= _SLOWEST_STROKE_MM_S)
            self.study.stroked(tile, 1e-3 * sum(step.duration_ms for step in moved))
        if self._recorder is not None:
            self._recorder.record(texture, steps)

    def end_touch(self) -> None:
        """End the touch."""
        if self._recorder is not None:
            self._recorder.end_touch()

    def begin(self, scenario: str, participant: str) -> str:
        """Begin a scenario; return a message for the page.

        Raises
        ------
        InputError
            There is no scenario of this name.
        MmtError
            The results cannot be written.
        """
        if not self._scenarios:
            raise InputError("this page plays a shared surface: it has no scenarios")
        if scenario not in SCENARIOS:
            raise InputError(f"scenario {scenario}: allowed are {', '.join(SCENARIOS)}")
        self.end_scenario()
        self.study = SCENARIOS[scenario](self.names, participant, self._seed, self.results.write)
        return f"{scenario} of {participant} begins"

    def end_scenario(self) -> str:
        """End the scenario, if one runs; return a message for the page."""
        study, self.study = self.study, None
        if study is not None:
            study.leave()
        return "all textures may be felt"


def picture(model: TextureModel, seed: int = 0) -> FloatArray:
    """Return a relief of zero mean and unit variance, shape (96, 96), y downwards.

    Parameters
    ----------
    model
        The texture's model.
    seed
        Seed of the phases.
    """
    per_mm = np.fft.fftfreq(SIZE, _WIDTH_MM / SIZE)
    across, down = np.meshgrid(per_mm, -per_mm)
    radius = np.hypot(across, down)
    powers = _powers(model, radius, np.arctan2(down, across))
    powers[radius < 1.0 / _LONGEST_MM] = 0.0
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((SIZE, SIZE)))
    relief = np.real(np.fft.ifft2(noise * np.sqrt(powers)))
    spread = float(relief.std())
    return np.asarray(relief / spread if spread > 0.0 else relief, dtype=np.float64)


def _powers(model: TextureModel, per_mm: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the powers of spatial frequencies (n, n) along headings (n, n)."""
    frequencies = np.linspace(0.0, model.rate_hz / 2.0, 257)
    angles = np.arange(_HEADINGS) * (2.0 * np.pi / _HEADINGS)
    motion = model.space.from_motion(
        _SPEED_MM_S * np.cos(angles), _SPEED_MM_S * np.sin(angles), _FORCE_N
    )
    spectra = model.spectrum(*motion.T, frequencies_hz=frequencies)
    # a relief has the same spectrum along opposite headings, and a wider ring has more pixels
    spectra = spectra + np.roll(spectra, _HEADINGS // 2, axis=0)
    row = np.round(heading / (2.0 * np.pi) * _HEADINGS).astype(int) % _HEADINGS
    column = per_mm * _SPEED_MM_S / (frequencies[1] - frequencies[0])
    inside = column < len(frequencies) - 1
    powers = spectra[row, np.where(inside, np.round(column), 0).astype(int)]
    return np.asarray(np.where(inside, powers, 0.0) / np.maximum(per_mm, 1e-9))
