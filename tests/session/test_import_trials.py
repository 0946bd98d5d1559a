"""Of several trials in the rows of one table each can be read, and one is, with a word."""

from dataclasses import replace

import numpy as np
import pytest
from recording_files import WRITERS, write_columns

from mmt.core.errors import InputError
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording

pytestmark = pytest.mark.usefixtures("read_here")

TIME_S = np.arange(0.0, 0.4, 0.001)


def force(trial):
    return np.column_stack([0 * TIME_S, 0 * TIME_S, 1 + trial + np.sin(9 * TIME_S)])


def table(names, label="trial", *, restarts=True, mixed=False):
    """Columns of the trials of these names, one after the other, or with their rows mixed."""
    parts = [
        {"time": TIME_S + (0 if restarts else place), label: np.full(len(TIME_S), name)}
        | dict(zip(("fx", "fy", "fz"), force(place).T, strict=True))
        for place, name in enumerate(names)
    ]
    whole = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    order = np.argsort(whole["time"], kind="stable") if mixed else slice(None)
    return {key: column[order] for key, column in whole.items()}


def read(path, episode=None):
    """Import a trial as proposed; return the force and the warnings."""
    proposal, _, error = try_proposal(path, propose(path, ImportOptions(episode=episode)))
    assert error is None
    session, report = import_recording(path, proposal.options)
    return session.frames["force_n"], report.warnings


@pytest.mark.parametrize("label", ["trial", "Episode ID", "run_no"])
@pytest.mark.parametrize("kind", [kind for kind in WRITERS if kind not in ("json", "npz", "tdms")])
def test_each_trial_of_a_table_can_be_read(tmp_path, kind, label):
    """Kinds whose package is lacking are left out by importorskip."""
    label = label.replace(" ", "_") if kind == "mat" else label
    name = f"a.{kind}"
    for names in ([3, 7, 20240102], ["slow", "fast", "day 2"]):
        write_columns(tmp_path / name, table(names, label))
        for place, trial in enumerate(names):
            found, warnings = read(tmp_path / name, trial)
            np.testing.assert_allclose(found, force(place), atol=1e-5)
            assert "--episode" not in str(warnings)
        found, warnings = read(tmp_path / name)
        np.testing.assert_allclose(found, force(0), atol=1e-5)
        told = f"tells 3 trials apart: {', '.join(map(str, names))}; this is {names[0]}, --episode"
        assert told in str(warnings)
        with pytest.raises(InputError, match=f"--episode 4: .*{names[1]}"):
            read(tmp_path / name, 4)


@pytest.mark.parametrize("restarts", [True, False])
@pytest.mark.parametrize("mixed", [True, False])
@pytest.mark.parametrize("names", [[0, 1], ["a", "b"]])
def test_trials_need_no_stretch_and_no_time_of_their_own(tmp_path, names, restarts, mixed):
    write_columns(tmp_path / "a.csv", table(names, restarts=restarts, mixed=mixed))
    for place, name in enumerate(names):
        found, _ = read(tmp_path / "a.csv", name)
        np.testing.assert_allclose(found, force(place), atol=1e-5)


def test_rows_between_trials_are_of_none(tmp_path):
    for rest in (0, ""):
        columns = table([1, rest, 2, rest, 3], restarts=False)
        write_columns(tmp_path / "a.csv", columns)
        for place, trial in ((0, None), (2, 2), (4, 3)):
            np.testing.assert_allclose(read(tmp_path / "a.csv", trial)[0], force(place), atol=1e-5)


def test_a_participants_trials_are_told_apart_by_both(tmp_path):
    columns = table([1, 2, 1, 2]) | {"subject": np.repeat(["anna", "ben"], 2 * len(TIME_S))}
    write_columns(tmp_path / "a.csv", columns)
    np.testing.assert_allclose(read(tmp_path / "a.csv", "ben_2")[0], force(3), atol=1e-5)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("trial", lambda _: 4),
        ("session", lambda _: "2024-01-02"),
        ("run", lambda row: row // 50 % 2),
        ("take", lambda row: row),
        ("file", lambda _: ""),
        ("runner", lambda row: row // 100),
    ],
)
def test_what_tells_no_trials_apart_changes_nothing(tmp_path, name, label):
    columns = table([1])
    columns[name] = np.array([label(row) for row in range(len(TIME_S))])
    write_columns(tmp_path / "a.csv", columns)
    proposal = propose(tmp_path / "a.csv").options
    found = import_recording(tmp_path / "a.csv", proposal)[0].frames["force_n"]
    np.testing.assert_allclose(found, force(0), atol=1e-5)
    with pytest.raises(InputError, match="--episode 1: it has no such episode or trial"):
        import_recording(tmp_path / "a.csv", replace(proposal, episode=1))


def test_of_a_trial_with_several_sensors_each_is_told_apart(tmp_path):
    head = ("t", "trial", "sensor", "value")
    each = [(t, n, s, t + n + 10 * k) for n in (1, 2) for t in TIME_S for k, s in enumerate("ab")]
    columns = map(np.array, zip(*each, strict=True))
    write_columns(tmp_path / "a.csv", dict(zip(head, columns, strict=True)))
    columns = {"time": "b.t", "force": "b.value"}
    for trial in (1, 2):
        options = ImportOptions(columns, episode=trial)
        found = import_recording(tmp_path / "a.csv", options)[0].frames["force_n"]
        np.testing.assert_allclose(found[:, 2], TIME_S + trial + 10, atol=1e-5)


def test_of_times_that_begin_anew_one_part_can_be_read(tmp_path):
    columns = table([1, 2, 3])
    del columns["trial"]
    write_columns(tmp_path / "a.csv", columns)
    for place in range(3):
        found, warnings = read(tmp_path / "a.csv", place + 1)
        np.testing.assert_allclose(found, force(place), atol=1e-5)
        assert "anew" not in str(warnings)
    found, warnings = read(tmp_path / "a.csv")
    assert len(found) == 3 * len(TIME_S)
    assert "--episode 1 takes the first part" in str(warnings)
    for episode in (0, 4, "a"):
        options = replace(propose(tmp_path / "a.csv").options, episode=episode)
        with pytest.raises(InputError, match=f"--episode {episode}: it has no such"):
            import_recording(tmp_path / "a.csv", options)


def test_a_clock_that_wraps_has_no_parts(tmp_path):
    columns = table([1, 2], restarts=False)
    columns["time"] = np.arange(800) * 1000 % 2**16
    del columns["trial"]
    write_columns(tmp_path / "a.csv", columns)
    options = ImportOptions({"time": "time"}, {"time": "us"}, episode=1)
    with pytest.raises(InputError, match="--episode 1: it has no such"):
        import_recording(
            tmp_path / "a.csv",
            replace(
                options, columns={"time": "time", "force_x": "fx", "force_y": "fy", "force_z": "fz"}
            ),
        )


def test_an_error_in_a_trial_names_the_line_of_the_file(tmp_path):
    columns = table([1, 2], mixed=True)
    columns["time"][1 + 2 * 100] = np.nan
    write_columns(tmp_path / "a.csv", columns)
    proposed = {"time": "time", "force_x": "fx", "force_y": "fy", "force_z": "fz"}
    with pytest.raises(InputError, match="line 203"):
        import_recording(tmp_path / "a.csv", ImportOptions(proposed, episode=2))
