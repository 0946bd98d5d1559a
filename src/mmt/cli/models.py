"""``mmt model``: build and show files of texture models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from mmt.cli.common import Force, json_option, messages, output, summary_table, write_json
from mmt.cli.main import command_group
from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import require_absent, write_file
from mmt.core.kernel_cache import compile_kernels
from mmt.scene import Scene, Texture
from mmt.session.data import RecordedSession
from mmt.session.stream import common_samples_per_frame

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from mmt.core.arrays import RecordArray
    from mmt.session.stream import Recording
    from mmt.texture.model.texture_model import TextureModel
    from mmt.texture.online.history import ModelHistory
    from mmt.texture.online.updates import ModelUpdate
    from mmt.texture.settings import ModellingSettings

SUFFIX = ".npz"

app = command_group("Build, select, convert and exchange texture models.")


@app.command("build")
def build_model(
    sources: Annotated[
        list[Path], typer.Argument(metavar="SESSION...", help="One or more recorded sessions.")
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The model, a .npz file.")],
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    whole: Annotated[
        bool,
        typer.Option("--whole", help="Continue past the stop criterion, to the end."),
    ] = False,
    surface: Annotated[
        int | None, typer.Option(min=1, help="The number of the surface, where there are several.")
    ] = None,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    force: Force = False,
) -> None:
    """Build a model of one or several sessions, as the live leader does, and save it."""
    if target.suffix.lower() != SUFFIX:
        raise InputError(f"model {target}: the name of a model file must end in {SUFFIX}")
    require_absent(target, force=force)
    compile_kernels(["mmt.cli.reporting"], messages.print)
    from mmt.cli.reporting import scene_of
    from mmt.session.stream import open_recording

    recordings = [open_recording(source) for source in sources]
    scene = scene_of(recordings[0], scene_file)
    model, _, history = built(recordings, scene, surface, whole=whole)
    write_file(target, model.to_bytes())
    figures = {
        "sessions": [str(source) for source in sources],
        "start_s": history.start_s,
        "stop_s": history.stop_s,
        **describe(model),
    }
    output.print(summary_table(target.name, {"model": figures}))
    write_json(json_file, figures)
    messages.print(f"model: {target}")


class ModelBuild(NamedTuple):
    """A model built from recordings, the update that it belongs to, and all updates."""

    model: "TextureModel"
    update: "ModelUpdate"
    history: "ModelHistory"


def built(
    recordings: "Sequence[Recording]",
    scene: Scene,
    surface: int | None = None,
    *,
    whole: bool = False,
) -> ModelBuild:
    """Build the model of recordings as the live leader does, up to the stop criterion.

    Parameters
    ----------
    recordings
        At least one recording.
    scene
        Scene with the settings of the modelling.
    surface
        Number of the surface, if there are several.
    whole
        Whether to continue past the stop criterion, as always with several recordings.

    Raises
    ------
    InputError
        A recording has no frames or covers several surfaces, or the recordings' rates differ.
    MmtError
        There are too few steady strokes.
    """
    from mmt.texture.online.history import build

    texture = scene.texture or Texture()
    settings = texture.settings(common_samples_per_frame(recordings))
    period_frames = max(1, round(texture.update_period_s * settings.rate_hz))
    history = build(_blocks(recordings, settings, surface, period_frames), settings)
    if not history.updates:
        raise _no_frames(recordings[0].path)
    number = len(history.updates) - 1
    if history.stop_s is not None and not whole and len(recordings) == 1:
        number = history.number(history.stop_s)
    model = history.model(number)
    if model is None:
        named = ", ".join(str(each.path) for each in recordings)
        remark = _remark(recordings[0], settings)
        raise MmtError(f"session {named}: too few steady strokes. {remark}")
    return ModelBuild(model, history.updates[number], history)


@app.command()
def info(
    source: Annotated[
        Path, typer.Argument(metavar="MODEL", help="A .npz file, or the name of a shipped model.")
    ],
    json_file: Annotated[Path | None, json_option("Write it there.")] = None,
) -> None:
    """Show what a model file holds."""
    from mmt.models import find_model
    from mmt.texture.model.texture_model import TextureModel

    figures = describe(TextureModel.load(find_model(source)))
    output.print(summary_table(source.name, {"model": figures}))
    write_json(json_file, figures)


def describe(model: "TextureModel") -> dict[str, Any]:
    """Return the properties of a model as JSON values."""
    from mmt.texture.completion.distance import distance_sum

    samples = model.samples
    return {
        "samples": len(samples),
        "order": model.order,
        "rate_hz": model.rate_hz,
        "inputs": model.space.name,
        "method": model.method,
        "tetrahedra" if model.space.directed else "triangles": len(model.triangulation.triangles),
        "distance": round(distance_sum(model.points), 3),
        "speed_mm_s": _range(samples.speed_mm_s, 1),
        "force_n": _range(samples.force_n, 3),
        "rms_m_s2": _range(samples.power**0.5, 4),
        "maximum_speed_mm_s": model.space.maximum_speed_mm_s,
        "maximum_force_n": model.space.maximum_force_n,
    }


def _range(values: FloatArray, digits: int) -> dict[str, float]:
    return {
        "least": round(float(values.min()), digits),
        "most": round(float(values.max()), digits),
    }


def _blocks(
    recordings: "Sequence[Recording]",
    settings: "ModellingSettings",
    surface: int | None,
    period_frames: int,
) -> "Iterable[RecordArray]":
    """Return the frames for each update: a period of one recording, or a whole one of several."""
    from mmt.session.stream import blocks_of, in_memory
    from mmt.texture.online.history import stream_blocks, trials

    if len(recordings) == 1 and settings.surfaces is None and surface is None:
        return stream_blocks(blocks_of(recordings[0]), period_frames)
    sessions = [in_memory(recording) for recording in recordings]
    for session in sessions:
        if len(session.frames) == 0:
            raise _no_frames(session.path)
    sessions = [_on_surface(session, settings, surface) for session in sessions]
    if len(sessions) == 1:
        return stream_blocks([sessions[0].frames], period_frames)
    return trials([session.frames for session in sessions])


def _no_frames(path: Path) -> InputError:
    return InputError(f"session {path}: it holds no frames, nothing can be modelled")


def _on_surface(
    session: RecordedSession, settings: "ModellingSettings", surface: int | None
) -> RecordedSession:
    """Return the part of a session on one surface; all of it without ``[texture.surfaces]``."""
    if settings.surfaces is None:
        if surface is not None:
            raise InputError("--surface: the scene has no [texture.surfaces], all is one surface")
        return session
    from mmt.evaluation.recorded_surfaces import part_by_surface

    found = part_by_surface(session, settings).sessions
    if surface is None and len(found) == 1:
        return next(iter(found.values()))
    if surface not in found:
        numbers = ", ".join(map(str, found))
        raise InputError(
            f"session {session.path}: it goes over the surfaces {numbers}; "
            "choose one with --surface"
        )
    return found[surface]


def _remark(recording: "Recording", settings: "ModellingSettings") -> str:
    from mmt.evaluation.strokes_made import StrokesMade, coverage
    from mmt.session.stream import blocks_of

    strokes = StrokesMade.from_frames(blocks_of(recording), settings)
    return coverage(strokes, None, settings, stopped=False).remark
