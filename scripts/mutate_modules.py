"""Run mutmut on modules, each in a copy of the tree, and print which changes no test noticed."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
LEAST_SHARE: Final = 0.9
"""Share of the changes that are to be noticed."""

MODULES: Final[dict[str, tuple[str, ...]]] = {
    "contact/estimation": (
        "contact/test_contact_detection.py",
        "contact/test_contact_estimation.py",
    ),
    "contact/least_squares": ("contact/test_least_squares.py",),
    "contact/passivity": ("contact/test_passivity.py", "contact/test_energies.py"),
    "contact/steps": ("contact/test_contact_steps.py",),
    "core/bounds": ("test_bounds.py",),
    "core/frames": ("test_frames.py",),
    "core/guards": ("test_guards.py", "leader/test_slew.py", "leader/test_streamed_force.py"),
    "core/quaternions": ("devices/test_orientation.py",),
    "core/rotations": ("devices/test_orientation.py",),
    "core/sequence_numbers": ("test_sequence_numbers.py", "link/test_link_reading.py"),
    "core/units": ("test_units.py",),
    "devices/adxl335/gravity": ("devices/test_adxl335_gravity.py",),
    "devices/adxl335/framing": (
        "devices/test_adxl335_framing.py",
        "devices/test_board_framing.py",
    ),
    "devices/ati/digital_wire": ("devices/test_digital_ft_codecs.py",),
    "devices/ati/gauges": ("devices/test_gauges.py",),
    "devices/haptuator/framing": ("devices/test_board_framing.py",),
    "devices/haptuator/driver": (
        "devices/test_haptuator_level.py",
        "devices/test_haptuator_signal.py",
        "devices/test_haptuator_sound.py",
    ),
    "devices/labjack/packets": ("devices/test_labjack_packets.py",),
    "devices/reading_checks": ("devices/test_plausibility.py",),
    "devices/streaming/sensor_clock": ("devices/test_sensor_clock.py",),
    "devices/streaming/tool_load": ("devices/test_tool_load.py", "devices/test_tool_turning.py"),
    "devices/streaming/tool_turning": ("devices/test_tool_turning.py",),
    "devices/wrench": ("devices/test_ati_wrench.py",),
    "follower/command_guard": ("follower/test_command_guard.py",),
    "follower/guarded_source": ("follower/test_guarded_source.py", "follower/test_motion_limit.py"),
    "follower/round_trips": ("follower/test_round_trips.py", "follower/test_command_guard.py"),
    "leader/backfill": ("leader/test_leader_backfill.py", "leader/test_missing_frames.py"),
    "leader/motion/feedback": ("leader/test_streamed_force.py", "leader/test_handle_loss.py"),
    "leader/motion/hand_contact": ("leader/test_follower_contact.py",),
    "leader/numbering": ("leader/test_numbering.py",),
    "leader/output/concealment": ("leader/test_concealment.py",),
    "leader/output/stream": (
        "leader/test_playout.py",
        "leader/test_stream.py",
        "leader/test_vibration_rates.py",
    ),
    "link/backfill": ("link/test_link_backfill_received.py",),
    "link/frame_sender": ("link/test_link_backfill.py",),
    "link/handshake": ("link/test_link_handshake.py",),
    "link/incoming": ("link/test_rate_limit.py", "link/test_link_reading.py"),
    "link/protocol": ("link/test_link_protocol.py", "link/test_link_receiving.py"),
    "link/queue": ("link/test_link_outbox.py", "link/test_link_backlog.py"),
    "link/websocket": (
        "link/test_link_websocket.py",
        "link/test_link_receiving.py",
        "link/test_link_other_clients.py",
        "link/test_link_session.py",
    ),
    "session/importing/readers/cells": ("session/test_import_cells.py",),
    "session/importing/checks": ("session/test_import_checks.py",),
    "session/importing/column_names": (
        "session/test_import_proposal.py",
        "session/test_import_mapping.py",
    ),
    "session/importing/columns": ("session/test_import_names.py",),
    "session/importing/framing": ("session/test_import_framing.py",),
    "session/importing/mapping": (
        "session/test_import_mapping.py",
        "session/test_import_orientation.py",
    ),
    "session/importing/options": ("session/test_import_options.py",),
    "session/importing/proposal": ("session/test_import_proposal.py",),
    "session/importing/samples": ("session/test_import_times.py",),
    "session/importing/stamps": ("session/test_session_stamps.py",),
    "session/mcap/writer": (
        "session/test_session_files.py",
        "session/test_session_recover.py",
        "session/test_session_stock_reader.py",
        "session/test_session_rates.py",
    ),
    "texture/completion/criterion": ("texture/test_completion_by_uncertainty.py",),
    "texture/completion/distance": (
        "texture/test_completion.py",
        "evaluation/test_strokes_made.py",
    ),
    "texture/model/file": ("texture/test_model_file.py",),
    "texture/model/texture_model": (
        "texture/test_model.py",
        "texture/test_model_file.py",
        "texture/test_resampled_models.py",
        "evaluation/test_plotting.py",
    ),
    "texture/segmentation/segmenter": (
        "texture/test_segmentation.py",
        "texture/test_segmentation_online.py",
    ),
    "texture/space": (
        "texture/test_samples.py",
        "texture/test_anisotropic_model.py",
        "texture/test_field_blocks.py",
        "texture/test_model.py",
    ),
}
"""Modules of ``mmt``, each with its tests in ``tests``."""

_READ_BY_TESTS: Final = ("configs", "docs", "scripts/firmware")

_SETTINGS: Final = """
[tool.mutmut]
source_paths = ["src"]
only_mutate = ["src/mmt/{module}.py"]
also_copy = {folders}
pytest_add_cli_args = ["-p", "no:cacheprovider", "-n", "0"]
pytest_add_cli_args_test_selection = {tests}
"""


def mutmut(directory: Path, *arguments: str) -> str:
    """Run mutmut in a directory and return what it prints."""
    command = [sys.executable, "-m", "mutmut", *arguments]
    done = subprocess.run(  # noqa: S603 - its arguments are made here
        command,
        cwd=directory,
        env={**os.environ, "HYPOTHESIS_PROFILE": "repeatable"},
        check=False,
        text=True,
        capture_output=True,
        timeout=3600,
    )
    if done.returncode:
        sys.exit(f"mutmut {' '.join(arguments)}: {done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


def mutate(module: str, directory: Path) -> tuple[int, int, list[str]]:
    """Return the number of changes of a module, that of noticed ones, and the unnoticed changes."""
    for folder in ("src", "tests", *_READ_BY_TESTS):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / folder, directory / folder, ignore=ignored)
    tests = [f"tests/{file}" for file in MODULES[module]]
    folders = json.dumps(_READ_BY_TESTS)
    settings = _SETTINGS.format(module=module, tests=json.dumps(tests), folders=folders)
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (directory / "pyproject.toml").write_text(text + settings, encoding="utf-8")
    mutmut(directory, "run")
    mutmut(directory, "export-cicd-stats")
    counts = json.loads((directory / "mutants/mutmut-cicd-stats.json").read_text(encoding="utf-8"))
    names = [line.split(":")[0].strip() for line in mutmut(directory, "results").splitlines()]
    missed = [mutmut(directory, "show", name) for name in names if name.startswith("mmt.")]
    return counts["total"], counts["killed"] + counts["timeout"], missed


def main(wanted: list[str]) -> None:
    """Mutate the named modules, or all if none is named; exit with 1 if one is below 90 %."""
    unknown = sorted(set(wanted) - set(MODULES))
    if unknown:
        sys.exit(f"scripts/mutate {unknown[0]}: allowed are {', '.join(MODULES)}")
    enough = True
    for module in wanted or MODULES:
        with tempfile.TemporaryDirectory(prefix="mmt-mutate-") as directory:
            total, noticed, missed = mutate(module, Path(directory))
        for difference in missed:
            print(difference)
        print(f"{module}: {noticed} of {total} changes noticed, {noticed / total:.0%}", flush=True)
        enough &= noticed >= LEAST_SHARE * total
    sys.exit(0 if enough else 1)


if __name__ == "__main__":
    main(sys.argv[1:])
