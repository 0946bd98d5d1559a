"""Answers to the page's requests on a recording: description, growth of the model, moments."""

from typing import Any, Final

from mmt.core.errors import InputError
from mmt.core.verdict import Facts, Verdict, verdict
from mmt.scene import Scene, Texture
from mmt.scene.files import scene_of_recording
from mmt.session.stream import SessionWindows
from mmt.session.windows import Window
from mmt.texture.model.texture_model import TextureModel
from mmt.web.monitor import states
from mmt.web.page_server import pack
from mmt.web.viewing import traces
from mmt.web.viewing.rebuilding import ModelRebuild, ModelState
from mmt.web.viewing.traces import LinkRecord, session_events, switch_s

LONGEST_COURSE_S: Final = 60.0
"""Longest span of force and position in one message."""
_CURVE_POINTS: Final = 1000
_MODEL_NEEDS: Final = ("position", "force", "acceleration")


class ViewedRecording:
    """A recording opened for viewing.

    Parameters
    ----------
    windows
        The recording.

    Notes
    -----
    Only one thread at a time may call `state_at` or `course`.
    """

    def __init__(self, windows: SessionWindows) -> None:
        self.windows = windows
        self._remarks: list[str] = []
        self.scene = self._scene()
        self._texture = self.scene.texture or Texture()
        self.settings = self._texture.settings(windows.samples_per_frame)
        self._link = LinkRecord(windows.events)
        self._rebuilding = self._rebuild()

    def start(self) -> None:
        """Start rebuilding the model in a thread."""
        if self._rebuilding is not None:
            self._rebuilding.start()

    def close(self) -> None:
        """Stop the thread."""
        if self._rebuilding is not None:
            self._rebuilding.close()

    # --- what the page asks for

    def opening(self) -> bytes:
        """Return the first message to the page: scene, duration, channels, events."""
        windows = self.windows
        header = {
            **states.hello_header(self.scene, windows.session_id or ""),
            "rate_hz": self.settings.vibration_rate_hz,
            "session": windows.path.name,
            "duration_s": windows.duration_s,
            "longest_course_s": LONGEST_COURSE_S,
            "link": self._link.exists,
            "switch_s": switch_s(windows.events),
            "remarks": self._remarks,
            "happenings": [[h.at_s, h.kind, h.sentence] for h in session_events(windows.events)],
        }
        return pack("opening", header, {})

    def growth(self) -> bytes:
        """Return the completion criterion against recording time, as far as it is rebuilt."""
        rebuilding = self._rebuilding
        known = list(rebuilding.states) if rebuilding is not None else []
        course = [(state.time_s, state.progress.value) for state in known]
        points = states.thinned(course, _CURVE_POINTS)
        header = {
            "start_s": next((s.start_s for s in known if s.start_s is not None), None),
            "reached_s": rebuilding.reached_s if rebuilding is not None else 0.0,
            "done": rebuilding is None or rebuilding.done,
            "problem": rebuilding.problem if rebuilding is not None else None,
        }
        arrays = {"time_s": [t for t, _ in points], "value": [v for _, v in points]}
        return pack("growth", header, arrays)

    def model(self, number: int) -> bytes:
        """Return the message with a model, given its number from a moment.

        Raises
        ------
        InputError
            There is no such model.
        """
        model = self._model(number)
        if model is None:
            raise InputError(f"there is no model {number}")
        return states.model_message(model)

    def course(self, from_s: float, to_s: float) -> bytes:
        """Return force, position and modes of vibration between two recording times.

        Only the first minute of a longer span is returned, since all its frames are read. Times
        are from ``from_s`` on: after some hours a float32 has no digit for milliseconds.
        """
        to_s = min(to_s, from_s + LONGEST_COURSE_S)
        window = self.windows.window(from_s, to_s)
        times_s, force_n, position_mm = traces.course(window)
        arrays = {"time_s": times_s - from_s, "force_n": force_n, "position_mm": position_mm}
        return pack("course", {"from_s": from_s, "modes": traces.modes(window.outputs)}, arrays)

    def state_at(self, time_s: float) -> bytes:
        """Return the state at a recording time, which is clamped to the recording."""
        windows = self.windows
        at_s = float(min(max(0.0, time_s), windows.duration_s))
        # half a millisecond more, to include the frame at this moment
        window = windows.window(at_s - traces.RECENT_S, at_s + 5e-4)
        state = self._rebuilding.at(at_s) if self._rebuilding is not None else None
        model = self._model(state.number) if state is not None else None
        played, source = self._played(window, at_s, model)
        header: dict[str, Any] = {
            "time_s": at_s,
            "model": state.number if state is not None else None,
            "completion": _completion(state),
            "surfaces": _surfaces(state),
            "rebuilt": self._rebuilding is None or at_s <= self._rebuilding.reached_s,
            "verdict": _verdict(at_s, _mode(window, at_s), state).as_dict(),
            "source": source,
            "link": self._link.at(at_s, window.arrivals) if self._link.exists else None,
        }
        arrays = {
            "measured": traces.measured(window, at_s, self.settings),
            "played": played.vibration_m_s2,
            "modelled": played.modelled,
            "trail": traces.motion_trace(window, self.settings),
        }
        return pack("moment", header, arrays)

    # ---

    def _model(self, number: int | None) -> TextureModel | None:
        if number is None or self._rebuilding is None:
            return None
        snapshots = self._rebuilding.snapshots
        return snapshots.model(number) if 0 <= number < len(snapshots) else None

    def _played(
        self, window: Window, at_s: float, model: TextureModel | None
    ) -> tuple[traces.Played, str | None]:
        """Return the recorded output, else the model's, with "recorded", "rendered" or None."""
        if self.windows.has_output:
            return traces.played(window.outputs, at_s), "recorded"
        if model is not None:
            return traces.synthesized(window, at_s, self.settings, model), "rendered"
        return traces.played((), at_s), None

    def _scene(self) -> Scene:
        recorded = self.windows.scene
        if recorded is None:
            self._remarks.append(
                "The recording holds no scene: its model is built by the defaults."
            )
            return Scene()
        try:
            scene = scene_of_recording(recorded, "the recorded scene")
        except InputError as error:
            self._remarks.append(f"The model is by the defaults: {error}")
            return Scene()
        if scene.texture is None:
            self._remarks.append("The scene built no model: this one is by the defaults.")
        return scene

    def _rebuild(self) -> ModelRebuild | None:
        lacking = [name for name in _MODEL_NEEDS if name not in self.windows.channels]
        if lacking:
            self._remarks = [f"No model: the recording has no {' and no '.join(lacking)} channel."]
            return None
        period_s = self._texture.update_period_s
        return ModelRebuild(self.windows, self.settings, period_s)


def _completion(state: ModelState | None) -> dict[str, Any] | None:
    if state is None:
        return None
    header = states.completion_header(state.progress, state.start_s, state.stop_s, state.faults)
    return {**header, "advice": None}  # no advice on strokes for a recording


def _verdict(at_s: float, mode: str | None, state: ModelState | None) -> Verdict:
    """Return the verdict on a moment; `mode` is None if no output was recorded."""
    if state is None:
        return verdict(Facts(time_s=at_s, mode=mode))
    progress = state.progress
    rises = progress.scale.rises
    return verdict(
        Facts(
            time_s=at_s,
            mode=mode,
            start_s=state.start_s,
            stop_s=state.stop_s,
            models=True,
            readiness=progress.value if rises else None,
            takes_over_at=progress.scale.start if rises else None,
            completion="" if rises else str(progress),
            faults=[f"not measured: {state.faults}"] if state.faults else [],
        )
    )


def _surfaces(state: ModelState | None) -> dict[str, int] | None:
    if state is None or state.surface is None:
        return None
    return {"now": state.surface, "known": state.surfaces}


def _mode(window: Window, at_s: float) -> str | None:
    """Return the mode of the actuator's vibration at a moment, or None without output."""
    return next((block.mode for block in reversed(window.outputs) if block.time_s <= at_s), None)
