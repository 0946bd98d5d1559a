"""The nine textures of the rendering library: three plastics, three fabrics, three woods.

All except `felt` depend on the heading of the stroke, as in paper B (Abdulali and Jeon,
Data-Driven Rendering of Anisotropic Haptic Textures, section 3.3). Levels are chosen as in
`mmt.testing.simulation.textures`; powers hold across the grain at 100 mm/s and 1 N.
"""

from typing import Final

from mmt.testing.simulation.modes import Grain, Line, Mode, Resonance
from mmt.testing.simulation.surfaces import Surface


def ridges(
    period_mm: float,
    powers: tuple[float, ...],
    width: float,
    grain: Grain | None = None,
    *,
    speed: float = 1.0,
    force: float = 0.7,
) -> tuple[Mode, ...]:
    """Return the harmonics of a surface that repeats itself, one line each.

    Parameters
    ----------
    period_mm
        Spatial period of the surface, across its ridges.
    powers
        Powers of the harmonics, (m/s2)^2.
    width
        Relative width of the lines.
    grain
        None for a surface that has this period in all directions.
    speed, force
        Exponents of the power.
    """
    return tuple(
        Line(power, speed, force, period_mm / harmonic, width, grain=grain)
        for harmonic, power in enumerate(powers, start=1)
    )


RIDGED_PLASTIC: Final = Surface(
    "ridged-plastic",
    (
        *ridges(1.8, (5.0, 2.0, 0.8), 0.06, Grain(0.0, 0.12)),
        Resonance(0.5, 1.1, 0.7, 225.0, 120.0, force_shift_hz=40.0, grain=Grain(0.0, 0.5)),
        Resonance(0.25, 1.1, 0.7, 200.0, 350.0),
    ),
    friction_coefficient=0.25,
)

BRUSHED_PLASTIC: Final = Surface(
    "brushed-plastic",
    (
        Resonance(2.2, 1.2, 0.7, 170.0, 180.0, speed_shift_hz=140.0, grain=Grain(90.0, 0.15)),
        Resonance(0.35, 1.0, 0.6, 90.0, 60.0, force_damping=0.3),
        Resonance(0.15, 1.2, 0.7, 260.0, 400.0),
    ),
    friction_coefficient=0.25,
)

KNURLED_PLASTIC: Final = Surface(
    "knurled-plastic",
    (
        *ridges(1.3, (3.5, 1.2), 0.07, Grain(30.0, 0.12)),
        *ridges(1.3, (3.5, 1.2), 0.07, Grain(-30.0, 0.12)),
        Resonance(0.6, 1.1, 0.7, 210.0, 350.0),
    ),
    friction_coefficient=0.35,
)

FELT: Final = Surface(
    "felt",
    (
        Resonance(0.20, 0.9, 0.6, 90.0, 150.0, speed_shift_hz=40.0),
        Resonance(0.12, 1.1, 0.5, 240.0, 160.0, force_shift_hz=60.0),
    ),
    friction_coefficient=0.45,
)

CANVAS: Final = Surface(
    "canvas",
    (
        *ridges(0.9, (1.5, 0.3), 0.10, Grain(0.0, 0.15)),
        *ridges(1.4, (1.2, 0.4), 0.10, Grain(90.0, 0.15)),
        Resonance(0.20, 1.0, 0.6, 70.0, 100.0, speed_shift_hz=50.0),
    ),
    friction_coefficient=0.5,
)

CORDUROY: Final = Surface(
    "corduroy",
    (
        *ridges(2.8, (2.5, 1.0, 0.4), 0.10, Grain(0.0, 0.12)),
        Resonance(0.5, 1.0, 0.6, 140.0, 180.0, speed_shift_hz=60.0, grain=Grain(90.0, 1.0, 0.6)),
    ),
    friction_coefficient=0.55,
)

OAK: Final = Surface(
    "oak",
    (
        Resonance(2.2, 1.1, 0.9, 80.0, 70.0, speed_shift_hz=120.0, grain=Grain(90.0, 0.3)),
        Resonance(0.8, 1.3, 0.5, 290.0, 90.0, force_shift_hz=-40.0, grain=Grain(90.0, 0.5)),
        Resonance(0.4, 1.1, 0.7, 190.0, 380.0),
    ),
    friction_coefficient=0.4,
)

PINE: Final = Surface(
    "pine",
    (
        *ridges(3.4, (2.0, 0.5), 0.25, Grain(15.0, 0.2), force=0.9),
        Resonance(0.5, 1.1, 0.7, 240.0, 120.0, speed_shift_hz=60.0, grain=Grain(15.0, 0.4)),
        Resonance(0.2, 1.1, 0.7, 150.0, 300.0),
    ),
    friction_coefficient=0.35,
)

SAWN_WOOD: Final = Surface(
    "sawn-wood",
    (
        *ridges(2.2, (3.5, 1.5, 0.6), 0.12, Grain(-40.0, 0.15), force=0.9),
        Resonance(1.2, 1.2, 0.8, 260.0, 220.0, grain=Grain(90.0, 0.5, 0.4)),
        Resonance(0.6, 1.0, 0.8, 90.0, 200.0),
    ),
    friction_coefficient=0.5,
)

GRAINED: Final = (
    RIDGED_PLASTIC,
    BRUSHED_PLASTIC,
    KNURLED_PLASTIC,
    FELT,
    CANVAS,
    CORDUROY,
    OAK,
    PINE,
    SAWN_WOOD,
)
"""Ridged: parallel ridges; brushed: scratches in one direction; knurled: two sets of ridges
that cross; felt: the same in all directions; canvas: two threads of different periods;
corduroy: wales, and a nap along them; oak: long pores; pine: year rings; sawn: saw marks
oblique to fibres that lift against the stroke."""
