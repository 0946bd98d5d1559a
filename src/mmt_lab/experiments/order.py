"""Order and update period: what a model costs a second, and how far off it is."""

from typing import Final

import numpy as np

from mmt.texture.settings import ModellingSettings
from mmt_lab.bench.measuring import spread
from mmt_lab.bench.textures import session
from mmt_lab.experiments.pipeline import ModelRun
from mmt_lab.harness.experiment import Experiment
from mmt_lab.harness.findings import Axis, Curves, Findings, Panel

TIME: Final = Axis("time of the updates (ms per second of session)", "ms/s")
SHAPE: Final = Axis("error of the spectrum (1 - GFC)", "1 - GFC")
LEVEL: Final = Axis("error of the power (dB rms)", "dB")


SURFACES: Final = ("plastic", "mesh", "wood")
DURATION_S: Final = 18.0
ORDERS: Final = (4, 8, 12, 16, 24, 40)
PERIODS_S: Final = (0.25, 0.5, 1.0, 2.0, 4.0)
MOMENTS_S: Final = (4.4, 6.1, 7.8, 10.3, 12.9, 16.6)
ROUNDS: Final = 3


def run() -> Findings:
    """Build models of every order with every period, and compare them with the truth."""
    sessions = [session(name, DURATION_S) for name in SURFACES]
    shape, level = Curves(), Curves()
    for period_s in PERIODS_S:
        name = f"period {period_s:g} s"
        for order in ORDERS:
            settings = ModellingSettings(order=order)
            runs = [ModelRun(one, settings, period_s, ROUNDS) for one in sessions]
            errors = np.mean([one.at(moment) for one in runs for moment in MOMENTS_S], axis=0)
            spent = np.array([one.spent_ms(DURATION_S) for one in runs])
            time = spread(spent / DURATION_S)
            shape.add(name, order, time, errors[0])
            level.add(name, order, time, errors[1])
    return Findings(
        title="Order and update period",
        about=(
            f"Sessions of {DURATION_S:g} s on {', '.join(SURFACES)}, modelled with "
            "every order and update period. Errors of the model that the leader has, against "
            "the known texture over the plane, the mean over textures and the moments "
            f"{', '.join(f'{moment:g}' for moment in MOMENTS_S)} s: a longer period costs "
            "less, and its model is older. Time of all stages of all updates; the least of "
            f"{ROUNDS} runs."
        ),
        panels=(
            Panel("spectrum", "Spectrum, by order", "order", TIME, SHAPE, shape.done()),
            Panel("power", "Power, by order", "order", TIME, LEVEL, level.done()),
        ),
    )


EXPERIMENT = Experiment(
    shows="what order and update period cost a second, and how far off the model is",
    duration="1 min",
    run=run,
    group="bench",
)
