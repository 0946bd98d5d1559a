"""The table of known textures; a new one is one more entry.

Levels are chosen within what is published for tool-mediated texture (0.1 to 15 m/s2 rms;
power rising about as speed^0.8..1.4 and force^0.4..1), not fitted to any recording.
Powers hold at 100 mm/s and 1 N, across the grain if there is one.

Nine are those of the rendering library: three plastics, three fabrics, three woods. All of them
except `felt` depend on the heading of the stroke, as in paper B (Abdulali and Jeon, Data-Driven
Rendering of Anisotropic Haptic Textures, section 3.3).
"""

import json
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from zlib import crc32

from mmt.core.errors import InputError
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.known_surfaces import (
    ALTERED_VERSION,
    COURSE_VERSION,
    GRAINED_VERSION,
    MODEL_VERSION,
    VERSION,
    KnownSurface,
)
from mmt.testing.simulation.surfaces.modes import Grain, Resonance, ridges
from mmt.testing.simulation.surfaces.surface import Surface, surface_from_parameters, with_bands

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

_PLASTIC = Surface(
    "plastic",
    (
        Resonance(1.6, 1.1, 0.7, 95.0, 55.0, speed_shift_hz=60.0, force_damping=0.3),
        Resonance(1.1, 1.2, 0.6, 215.0, 60.0, force_shift_hz=50.0, force_damping=0.3),
        Resonance(0.35, 1.3, 0.6, 370.0, 80.0),
        Resonance(0.12, 1.2, 0.7, 240.0, 420.0),
    ),
    friction_coefficient=0.25,
)

_MESH = Surface(
    "mesh",
    (
        *ridges(1.6, (5.0, 2.0, 0.8), 0.06),
        Resonance(0.7, 1.1, 0.7, 180.0, 350.0),
    ),
    friction_coefficient=0.35,
)

_FABRIC = Surface(
    "fabric",
    (
        Resonance(0.12, 1.0, 0.6, 60.0, 90.0, speed_shift_hz=50.0),
        Resonance(0.05, 1.2, 0.5, 190.0, 180.0),
    ),
    friction_coefficient=0.5,
)

_SANDPAPER = Surface(
    "sandpaper",
    (
        Resonance(3.0, 1.2, 0.8, 150.0, 300.0, speed_shift_hz=80.0),
        Resonance(2.4, 1.3, 0.8, 330.0, 260.0),
        Resonance(0.6, 1.0, 0.8, 60.0, 80.0),
    ),
    friction_coefficient=0.6,
)

_WOOD = Surface(
    "wood",
    (
        Resonance(1.5, 1.0, 0.9, 70.0, 50.0, speed_shift_hz=90.0),
        Resonance(0.7, 1.4, 0.5, 290.0, 70.0, speed_shift_hz=60.0, force_shift_hz=-40.0),
        Resonance(0.5, 1.2, 0.7, 190.0, 380.0),
    ),
    friction_coefficient=0.4,
)

_RIBBED = Surface(
    "ribbed",
    (
        *ridges(2.4, (5.4, 2.4, 1.0, 0.4), 0.04, speed=0.9, force=0.8),
        Resonance(0.3, 1.0, 0.8, 230.0, 300.0),
    ),
    friction_coefficient=0.3,
)

_RUBBER = Surface(
    "rubber",
    (
        Resonance(0.5, 2.0, 0.5, 75.0, 70.0, force_shift_hz=40.0, force_damping=0.6),
        Resonance(0.2, 2.1, 0.4, 170.0, 110.0, speed_shift_hz=70.0, force_damping=0.6),
    ),
    friction_coefficient=0.9,
)

_GLASS = Surface(
    "glass",
    (
        Resonance(0.009, 1.0, 0.5, 260.0, 90.0, speed_shift_hz=50.0),
        Resonance(0.007, 0.9, 0.5, 120.0, 320.0),
    ),
    friction_coefficient=0.15,
)

SURFACES: Final[Mapping[str, Surface]] = MappingProxyType(
    {
        surface.name: surface
        for surface in (
            *(_PLASTIC, _MESH, _FABRIC, _SANDPAPER, _WOOD, _RIBBED, _RUBBER, _GLASS),
            *GRAINED,
        )
    }
)
"""Every known texture by name. Plastic and wood: smooth resonances; mesh and ribbed: lines
that follow the speed; fabric: soft and low; sandpaper: loud and broad; rubber: power as
speed squared; glass: little above the accelerometer's noise. `GRAINED` describes the
other nine."""


_DRAWN: Final = re.compile(r"(drawn|final)-(\d{1,6})", re.ASCII)


def get_surface(name: str, rate_hz: float = RATE_HZ) -> KnownSurface:
    """Return the known texture of this name at a rate.

    Parameters
    ----------
    name
        One of `SURFACES`; a model's file; ``drawn-N``, a texture drawn for development, or
        ``final-N``, see `mmt.testing.simulation.surfaces.drawn_textures`; or one of these followed
        by ``+patches`` or ``+bursts``, see
        `mmt.testing.simulation.surfaces.altered_surface.alter_surface`.
    rate_hz
        Samples of acceleration a second, a multiple of 1000; above 1000 a texture that is no model
        has bands above 500 Hz as well, see `mmt.testing.simulation.surfaces.surface.with_bands`.

    Raises
    ------
    InputError
        The name is not known, and the message lists the allowed ones; or the file is not usable.
    """
    if name in SURFACES:
        return with_bands(SURFACES[name], rate_hz, crc32(name.encode()))
    if drawn := _DRAWN.fullmatch(name):
        from mmt.testing.simulation.surfaces.drawn_textures import FINAL, draw_texture

        return draw_texture(name, int(drawn[2]) + FINAL * (drawn[1] == "final"), rate_hz)
    if name.lower().endswith((".npz", ".xml")):
        from mmt.testing.simulation.surfaces.model_surface import load_surface

        return load_surface(name, rate_hz)
    base, altered, alteration = name.rpartition("+")
    if altered:
        from mmt.testing.simulation.surfaces.altered_surface import alter_surface

        return alter_surface(get_surface(base, rate_hz), alteration, crc32(name.encode()))
    raise InputError(
        f"surface is {name!r}, allowed are {', '.join(SURFACES)}, drawn-N and final-N (N up to "
        "999999), and files of models (.npz, .xml), each with +patches or +bursts behind it or not"
    )


def surface_from_annotations(annotations: bytes) -> KnownSurface:
    """Rebuild the surface that a recording's annotations describe.

    Raises
    ------
    InputError
        The bytes hold no truth of a known version.
    """
    try:
        truth = json.loads(annotations)
        version, name, parameters = truth["version"], str(truth["surface"]), truth["parameters"]
        if version == COURSE_VERSION:
            raise InputError("the session goes over several surfaces: mmt lab surfaces")
        if version == MODEL_VERSION:
            from mmt.testing.simulation.surfaces.model_surface import from_parameters

            return from_parameters(name, parameters)
        if version == ALTERED_VERSION:
            from mmt.testing.simulation.surfaces.altered_surface import from_altered_parameters

            base = surface_from_annotations(json.dumps(parameters["base"]).encode())
            return from_altered_parameters(name, base, parameters)
        if version in {VERSION, GRAINED_VERSION}:
            return surface_from_parameters(name, parameters)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"annotations hold no simulated truth: {error!r}") from error
    raise InputError(
        f"annotations: version {version} of the simulated truth is not known, this program reads "
        f"{VERSION}, {GRAINED_VERSION}, {MODEL_VERSION} and {ALTERED_VERSION}"
    )
