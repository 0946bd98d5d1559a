"""The part that plays vibration, and its switch between the stream and the model."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.guards import VibrationSlew
from mmt.leader.motion.hand import loss_metrics
from mmt.leader.output.renderer import (
    MotionFollowing,
    SynthesizedVibration,
    TouchDownRenderer,
    crossfaded,
)
from mmt.leader.part import Part, Session, Tick
from mmt.scene import Actuator

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.devices.protocols import VibrationActuator
    from mmt.devices.reconnection import ReconnectingActuator
    from mmt.leader.output.synthesis import Landing, StreamedMotion

Mode = Literal["silent", "streamed", "fading", "synthesized"]


class VibrationSwitch:
    """Choose between two sources of vibration, sample by sample, some samples a tick.

    The crossfade keeps the power of two uncorrelated signals (gains cosine and sine). It can
    be reversed at any moment without a step.

    Parameters
    ----------
    streamed
        Called once a tick with the leader's time in ns, returns the samples of the streamed
        vibration in m/s2; None if the scene has none.
    synthesized
        The model's vibration, or None if the scene has none.
    crossfade_samples
        Length of a full fade; 0 switches at once.
    period_ns
        Time between ticks.
    samples_per_tick
        Samples of vibration in a tick.
    """

    def __init__(
        self,
        streamed: Callable[[int], Sequence[float]] | None,
        synthesized: SynthesizedVibration | None,
        *,
        crossfade_samples: int,
        period_ns: int = 1_000_000,
        samples_per_tick: int = 1,
    ) -> None:
        self._streamed = streamed
        self.synthesized: Final = synthesized
        """The model's vibration, or None."""
        self._unheard = synthesized if isinstance(synthesized, MotionFollowing) else None
        renderer: object = synthesized
        self._touching = renderer if isinstance(renderer, TouchDownRenderer) else None
        self._step = 1.0 / crossfade_samples if crossfade_samples > 0 else 1.0
        self._period_ns = period_ns
        self._samples_per_tick = samples_per_tick
        self._share = 0.0  # of the synthesized vibration
        self._target = 0.0

    @property
    def mode(self) -> Mode:
        """Which vibration is played now."""
        if self._share != self._target:
            return "fading"
        if self._share == 1.0:
            return "synthesized"
        return "streamed" if self._streamed is not None else "silent"

    @property
    def streams(self) -> bool:
        """Whether there is streamed vibration."""
        return self._streamed is not None

    def use_model(self, wanted: bool) -> None:
        """Fade to the model's vibration, or back to the streamed one."""
        self._target = 1.0 if wanted and self.synthesized is not None else 0.0

    def touch_down(self, approach_speed_mm_s: float) -> None:
        """Render the transient of a touch-down, while the model is heard."""
        if self._share > 0.0 and self._touching is not None:
            self._touching.touch_down(approach_speed_mm_s)

    def render(self, now_ns: int, *inputs: FloatArray) -> FloatArray:
        """Return the vibration of the elapsed ticks in m/s2, shape (n,).

        Parameters
        ----------
        now_ns
            The leader's time of the last of these ticks.
        *inputs
            Inputs of the model, in the order of its input space, each of shape (n,).
        """
        count = len(inputs[0])
        streamed = self._pulled(now_ns, count // self._samples_per_tick)
        if self._share == self._target == 0.0:
            if self._unheard is not None:
                self._unheard.follow(*inputs)
            return np.array(streamed) if streamed else np.zeros(count)
        model = self.synthesized
        synthesized = model.render(*inputs) if model is not None else np.zeros(count)
        if self._share == self._target == 1.0:
            return synthesized
        heard = np.array(streamed) if streamed else np.zeros(count)
        return crossfaded(self._advance(count), heard, synthesized)

    def _pulled(self, now_ns: int, ticks: int) -> Sequence[float]:
        """Return the streamed samples of the elapsed ticks, none if nothing is streamed."""
        if self._streamed is None:
            return ()
        if ticks == 1:
            return self._streamed(now_ns)
        first_ns = now_ns - (ticks - 1) * self._period_ns
        times_ns = range(first_ns, now_ns + 1, self._period_ns)
        return [value for time_ns in times_ns for value in self._streamed(time_ns)]

    def _advance(self, count: int) -> FloatArray:
        """Return the model's share in each of the next samples (n,)."""
        steps = self._step * np.arange(1, count + 1)
        share: FloatArray = np.clip(self._share + (steps if self._target else -steps), 0.0, 1.0)
        self._share = float(share[-1])
        return share


class VibrationPart(Part):
    """Render vibration once a tick, and give it to the actuator.

    Parameters
    ----------
    session
        Session of the run.
    actuator
        Plays the vibration.
    switch
        Chooses the vibration.
    slew
        Bounds the vibration.
    reconnecting
        The same actuator, if it is a driver's and may be lost and come back.
    motion
        Drives the model if there is no hand.
    landing
        Detects when the hand touches down; None if no touch-down is rendered.
    """

    def __init__(
        self,
        session: Session,
        actuator: "VibrationActuator",
        switch: VibrationSwitch,
        slew: VibrationSlew,
        reconnecting: "ReconnectingActuator | None" = None,
        motion: "StreamedMotion | None" = None,
        landing: "Landing | None" = None,
    ) -> None:
        self._session = session
        self.actuator = actuator
        self.switch = switch
        self.reconnecting = reconnecting
        self._slew = slew
        self.mode = switch.mode
        """Which vibration is played, as of the last tick."""
        normal = "xyz".index(session.scene.normal)
        self._first, self._second = (axis for axis in range(3) if axis != normal)
        self._motion, self._landing = motion, landing
        self._inputs_before: tuple[float, ...] = ()
        self._samples = session.samples_per_frame
        self._back = np.arange(self._samples - 1, 0, -1) / self._samples
        """Ticks from each sample of a tick, but the last, to the end of the tick."""
        self._on_output: list[Callable[[int, str, FloatArray], None]] = []
        if reconnecting is not None:
            reconnecting.watch(session.journal.event)

    @property
    def name(self) -> str:
        """The actuator's name."""
        device = self.actuator if self.reconnecting is None else self.reconnecting.device
        return type(device).__name__

    def connect(self) -> None:
        """Open the actuator and calibrate it."""
        self.actuator.connect()
        self.actuator.calibrate()
        self._on_output = self._session.parts.verbs("on_output")

    def response(self) -> "Callable[[FloatArray], tuple[FloatArray, float]] | None":
        """Return the function for the actuator's response by frequency, or None if unknown."""
        if self.reconnecting is None:
            return None
        from mmt.devices.protocols import RespondingActuator

        device = self.reconnecting.device
        return device.response if isinstance(device, RespondingActuator) else None

    def close(self) -> None:
        """Release the actuator."""
        self.actuator.close()

    def tick(self, tick: Tick) -> None:
        """Let the actuator play the elapsed ticks, once the stream has begun."""
        if not tick.begun:
            return
        elapsed = tick.elapsed
        inputs = self._inputs(*self._drive(tick))
        approach_mm_s = self._landing.step(tick.state, elapsed) if self._landing else 0.0
        if approach_mm_s > 0.0:
            self.switch.touch_down(approach_mm_s)
        vibration = self.switch.render(tick.now_ns, *self._courses(inputs, elapsed))
        self._guard(vibration, silent=tick.hand_lost or tick.overridden)
        self.actuator.write(vibration)
        mode = self.switch.mode
        behind = len(vibration) - 1
        first_ns = tick.now_ns - behind * self._session.period_ns // self._samples
        for listener in self._on_output:
            listener(first_ns, mode, vibration)
        if mode != self.mode:
            self.mode = mode
            journal = self._session.journal
            self._session.log.switches.append({"time_s": journal.time_s, "mode": mode})
            journal.event(f"vibration {mode}", mode=mode)

    def status(self) -> dict[str, Any]:
        """Return which vibration is played."""
        return {"mode": self.mode}

    def faults(self) -> list[str]:
        """Return why the actuator is lost."""
        problem = None if self.reconnecting is None else self.reconnecting.problem
        return [problem] if problem else []

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return the mode at the end, every switch, and the counts of the actuator."""
        actuator = asdict(self.actuator.statistics)
        if self.reconnecting is not None:
            actuator |= self.reconnecting.losses_summary
        return {
            "vibration": {
                "mode": self.switch.mode,
                "switches": self._session.log.switches,
                "slew_limited": self._slew.limited_samples,
                "not_finite": self._slew.guard.not_finite,
                "actuator": actuator,
            }
        }

    def metrics(self) -> "Iterable[Metric]":
        """Return the mode of vibration, and the actuator's losses."""
        from mmt.core.output.exposition import state

        text = "What drives the actuator."
        yield state("vibration_mode", text, "mode", self.mode, get_args(Mode))
        yield from loss_metrics(self.reconnecting)

    def _guard(self, vibration: FloatArray, *, silent: bool) -> None:
        """Bound the vibration (n,) in place, and report once if it was not finite.

        The vibration fades out while handle or control is away (`silent`), and in again.
        """
        before = self._slew.guard.not_finite
        self._slew.limit(vibration, silent=silent)
        if not before and self._slew.guard.not_finite:
            self._session.journal.event(
                "the vibration was no number: it fades to silence where it is none, and the "
                "summary has how often"
            )

    def _drive(self, tick: Tick) -> tuple[float, float, float]:
        """Return the velocity over the surface and the force: the hand's, if there is one."""
        state = tick.state
        if state is not None:
            velocity = state.velocity_mm_s
            force_n = state.force_n if state.contact else 0.0
            return velocity[self._first], velocity[self._second], force_n
        if self._motion is None:
            return 0.0, 0.0, 0.0
        x_mm_s, y_mm_s, force_n = self._motion.step(tick.elapsed)
        return x_mm_s, y_mm_s, force_n

    def _inputs(self, x_mm_s: float, y_mm_s: float, force_n: float) -> tuple[float, ...]:
        """Return the inputs of the current model."""
        synthesized = self.switch.synthesized
        if synthesized is not None and synthesized.directed:
            return x_mm_s, y_mm_s, force_n
        return (x_mm_s * x_mm_s + y_mm_s * y_mm_s) ** 0.5, force_n

    def _courses(self, inputs: tuple[float, ...], elapsed: int) -> list[FloatArray]:
        """Return the inputs at each sample of the elapsed ticks, each of shape (n,).

        Within one tick they go linearly from the inputs of the tick before to the new ones: steps
        would change the amplitude a thousand times a second.
        """
        count = elapsed * self._samples
        courses = [np.full(count, value) for value in inputs]
        if self._samples > 1 and len(inputs) == len(self._inputs_before):
            for course, value, before in zip(courses, inputs, self._inputs_before, strict=True):
                course[: self._samples - 1] += (before - value) * self._back
        self._inputs_before = inputs
        return courses


def build_actuator(
    table: Actuator, rate_hz: float
) -> "tuple[VibrationActuator, ReconnectingActuator | None]":
    """Return the scene's actuator, and the same again if it may be lost and come back, else None.

    Raises
    ------
    InputError
        The driver cannot be used, or does not play samples of this rate.
    """
    if table.driver is None:
        from mmt.testing.simulation.actuator import SimulatedActuator

        return SimulatedActuator(limit_m_s2=table.limit_m_s2), None
    from mmt.devices.drivers import load_device
    from mmt.devices.protocols import USUAL_RATE_HZ, RateFollowing
    from mmt.devices.reconnection import ReconnectingActuator

    device = load_device(table.driver, table.options, role="actuator")
    if isinstance(device, RateFollowing):
        device.set_rate(rate_hz)
    elif rate_hz != USUAL_RATE_HZ:
        raise InputError(
            f"actuator.driver {table.driver!r} plays {USUAL_RATE_HZ:g} samples a second, "
            f"session.acceleration_rate_hz is {rate_hz:g}: set it to {USUAL_RATE_HZ:g}, or use "
            "a driver that follows the session's rate (it has 'set_rate')"
        )
    reconnecting = ReconnectingActuator(device)
    return reconnecting, reconnecting
