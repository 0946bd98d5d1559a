"""``mmt model import`` and ``export``: models of other programs, and vibration as files."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mmt.cli.common import Force, json_option, messages, output, summary_table, write_json
from mmt.cli.models import SUFFIX, describe
from mmt.core.errors import InputError
from mmt.core.files.existing import require_absent, write_file

if TYPE_CHECKING:
    from mmt.core.arrays import FloatArray
    from mmt.texture.model.texture_model import TextureModel

_LONGEST_S = 3600.0
_VIBRATION = {".wav": 44_100, ".hjif": 8_000, ".ahap": 44_100}
"""Default sampling rate in Hz of each kind of vibration file."""
_OF_PAGES = (".html", ".json")
_OF_XML = ("material", "friction")
_OF_A_STEADY_MOTION = ("speed", "heading", "normal_force", "seconds")
_OF_VIBRATION = ("motion", *_OF_A_STEADY_MOTION, "rate", "full_scale", "seed")


def import_model(
    source: Annotated[
        Path, typer.Argument(metavar="FILE", help="A model of the Penn toolkit (HaTT), .xml.")
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The model, a .npz file.")],
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    force: Force = False,
) -> None:
    """Import a model from an XML file of the Penn Haptic Texture Toolkit."""
    from mmt_bridges.hatt.models import import_hatt

    if target.suffix.lower() != SUFFIX:
        raise InputError(f"model {target}: the name of a model file must end in {SUFFIX}")
    require_absent(target, force=force)
    imported = import_hatt(source)
    write_file(target, imported.model.to_bytes())
    figures: dict[str, Any] = {
        "material": imported.material,
        "friction": imported.friction,
        "zeros": imported.zeros,
        "spectrum_error_db": round(imported.spectrum_error_db, 4),
        "same_triangles": imported.same_triangles,
        **describe(imported.model),
    }
    output.print(summary_table(target.name, {"model": figures}))
    write_json(json_file, figures)
    messages.print(f"model: {target}")


def export_model(
    context: typer.Context,
    *,
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL...", help="A .npz file, or a shipped model; .html: several."),
    ],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="A page (.html), .json or .xml (HaTT), or its vibration: .wav, .hjif or .ahap.",
        ),
    ],
    material: Annotated[
        str | None, typer.Option(help="XML: the texture's name, by default the file's.")
    ] = None,
    friction: Annotated[
        float | None, typer.Option(min=0.0, help="XML: coefficient of kinetic friction.")
    ] = None,
    motion: Annotated[
        Path | None, typer.Option(help="Vibration: move as in this recorded session.")
    ] = None,
    speed: Annotated[
        float, typer.Option(min=0.0, help="Vibration: speed in mm/s, without --motion.")
    ] = 100.0,
    heading: Annotated[
        float, typer.Option(help="Vibration: in this direction, degrees from x towards y.")
    ] = 0.0,
    normal_force: Annotated[
        float, typer.Option(min=0.0, help="Vibration: normal force in N.")
    ] = 1.0,
    seconds: Annotated[
        float, typer.Option(min=0.001, max=_LONGEST_S, help="Vibration: for so long.")
    ] = 5.0,
    rate: Annotated[
        int | None,
        typer.Option(
            min=100, max=384_000, help="Samples a second, by default 44100; of .hjif 8000."
        ),
    ] = None,
    full_scale: Annotated[
        float | None,
        typer.Option(help="m/s2 that the largest number stands for, else the loudest."),
    ] = None,
    with_sound: Annotated[
        bool, typer.Option("--with-sound", help="AHAP: with a .wav file beside it, to be heard.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Vibration: its seed.")] = 0,
    force: Force = False,
) -> None:
    """Write a model as .html (page), .json or .xml (HaTT), or vibration as .wav, .hjif or .ahap."""
    from mmt.models import find_model
    from mmt.texture.model.texture_model import TextureModel

    suffix = target.suffix.lower()
    sound = target.with_suffix(".wav") if with_sound and suffix == ".ahap" else None
    for path in (target, sound):
        if path is not None:
            require_absent(path, force=force)
    if suffix not in {*_OF_PAGES, ".xml", *_VIBRATION}:
        raise InputError(
            f"{target}: the name must end in .html, .json, .xml, .wav, .hjif or .ahap, which says "
            "what is written"
        )
    if len(sources) > 1 and suffix != ".html":
        raise InputError(f"{target} takes one model, not {len(sources)}; a page (.html) several")
    if with_sound and sound is None:
        raise InputError(f"{target}: --with-sound is for .ahap")
    if suffix in {*_OF_PAGES, ".xml"}:
        _refuse(context, _OF_VIBRATION, f"is for vibration ({', '.join(_VIBRATION)}), not {target}")
    if suffix != ".xml":
        _refuse(context, _OF_XML, f"is for .xml, not {target}")
    if motion is not None:
        _refuse(context, _OF_A_STEADY_MOTION, "does not go with --motion, which says it already")
    models = [TextureModel.load(find_model(source)) for source in sources]
    if suffix in _OF_PAGES:
        _write_page(models, [source.stem for source in sources], target)
        return
    source, model = sources[0], models[0]
    if suffix == ".xml":
        from mmt_bridges.hatt.models import export_hatt

        name = material if material is not None else source.stem
        write_file(target, export_hatt(model, name, friction))
        messages.print(f"model: {target}")
        return
    from mmt_bridges.haptics.effects import effect

    velocity_mm_s, force_n, motion_hz = (
        _constant(speed, heading, normal_force, seconds) if motion is None else _recorded(motion)
    )
    rate = rate if rate is not None else _VIBRATION[suffix]
    samples = effect(model, velocity_mm_s, force_n, motion_hz=motion_hz, output_hz=rate, seed=seed)
    _write_vibration(target, samples, rate, full_scale, source.stem, sound)


def _refuse(context: typer.Context, options: tuple[str, ...], why: str) -> None:
    """Raise `InputError` if one of these options was given on the command line."""
    for name in options:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise InputError(f"--{name.replace('_', '-')} {why}")


def _write_vibration(
    target: Path,
    samples: "FloatArray",
    rate_hz: int,
    full_scale_m_s2: float | None,
    name: str,
    sound: Path | None,
) -> None:
    from mmt_bridges.haptics import ahap, effects, hjif

    writers: dict[str, tuple[str, Callable[..., effects.EffectFile]]] = {
        ".wav": ("sound", effects.write_wav),
        ".hjif": ("haptics", partial(hjif.write_hjif, description=name)),
        ".ahap": ("pattern", partial(ahap.write_ahap, sound=sound.name if sound else None)),
    }
    kind, write = writers[target.suffix.lower()]
    written = write(target, samples, rate_hz, full_scale_m_s2)
    messages.print(
        f"{kind}: {target}, {written.seconds:.2f} s at {rate_hz} Hz, full scale "
        f"{written.full_scale_m_s2:.4g} m/s2"
    )
    if sound is not None:
        _write_vibration(sound, samples, rate_hz, full_scale_m_s2, name, None)


def _write_page(models: "list[TextureModel]", names: list[str], target: Path) -> None:
    from mmt.texture.model.json_form import model_json
    from mmt.web.texture_page import texture_page

    forms = [model_json(model, name) for model, name in zip(models, names, strict=True)]
    page = target.suffix.lower() == ".html"
    content = texture_page(forms) if page else forms[0].encode()
    write_file(target, content)
    messages.print(
        f"{'page' if page else 'model'}: {target}, {len(content) / 1e3:.0f} kB"
        + ("; open it in any browser" if page else "")
    )


def _constant(
    speed_mm_s: float, heading_deg: float, force_n: float, seconds: float
) -> "tuple[FloatArray, FloatArray, float]":
    import numpy as np

    motion_hz = 100.0
    count = max(1, int(np.ceil(seconds * motion_hz)))
    angle = np.radians(heading_deg)
    velocity = speed_mm_s * np.array([np.cos(angle), np.sin(angle)])
    return np.tile(velocity, (count, 1)), np.full(count, force_n), count / seconds


def _recorded(path: Path) -> "tuple[FloatArray, FloatArray, float]":
    """Return velocity and normal force of a session, filtered as for modelling, and their rate."""
    from mmt.cli.reporting import scene_of
    from mmt.scene import Texture
    from mmt.session.files import read_session
    from mmt.texture.signals.filtering import StreamFilter

    session = read_session(path)
    scene = scene_of(session, None)
    settings = (scene.texture or Texture()).settings(session.samples_per_frame)
    aligned = StreamFilter(settings).process(session.frames)
    if not len(aligned):
        raise InputError(f"session {path}: it holds too few frames to tell a motion")
    return aligned.velocity_mm_s, aligned.normal_force_n, settings.rate_hz
