"""Options of an import are proposed from the names, units and times of a file's columns."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.importing.checks import ChannelReport, ImportReport
from mmt.session.importing.column_names import names_of, of_file, of_one_trial, target_of
from mmt.session.importing.columns import SourceColumns
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import Proposal, propose, try_proposal
from mmt.session.importing.recording import import_recording

TIMES = [f"{n / 1000:.3f}" for n in range(40)]


def table(folder, header, *columns):
    """Write columns of cells, by default times in each, and return the path."""
    columns = columns or [TIMES] * (header.count(",") + 1)
    rows = [header, *(",".join(map(str, row)) for row in zip(*columns, strict=True))]
    (folder / "a.csv").write_text("\n".join(rows), encoding="utf-8")
    return folder / "a.csv"


NAMES = """
t,Fz -> time=t force_xyz=0,0,Fz
0,t,Fz,load -> time=t force_xyz=0.0,0.0,Fz
t,x,pos_y,tipZ -> time=t position_xyz=x,pos_y,tipZ
t,ax,accel_y,az -> time=t acceleration_xyz=ax,accel_y,az
t,f,p,a,v -> time=t speed=v
t,log.run.f,log.a -> time=t force=log.run.f acceleration=log.a
t,vx,vy -> time=t
t,v,x -> time=t position_xyz=x,0,0
t,v,position_x_mm -> time=t
Date,Time,load -> time=Time force=load
X_Value,load -> time=X_Value force=load
DATE,load -> time=DATE force=load
ts,load -> time=ts force=load
log.Epoch,load -> time=log.Epoch force=load
acc_t,acc,force,t_force,pos_x,pos time_ms ->
    acceleration=acc force=force position_xyz=pos_x,0,0 acceleration_time=acc_t
    force_time=t_force position_time=pos time_ms
log.acc.t,log.acc.data,force.signals.values,force.time,robot.v,robot.t,rate ->
    time=log.acc.t acceleration=log.acc.data force=force.signals.values speed=robot.v
    force_time=force.time position_time=robot.t
run.t,run.acc,run.force.value -> time=run.t acceleration=run.acc force=run.force.value
tip.data,tip.note -> position_xyz=tip.data,0,0
Time in s,Force in mN,Acceleration m/s^2 ->
    time=Time in s force=Force in mN acceleration=Acceleration m/s^2
t,pos_in,Position (mm) -> time=t position_xyz=pos_in,0,0
linear_acceleration_t,ax,fz -> acceleration_xyz=ax,0,0 force_xyz=0,0,fz
    acceleration_time=linear_acceleration_t
t_pos,x,t_force,fz -> position_xyz=x,0,0 force_xyz=0,0,fz position_time=t_pos force_time=t_force
host_time,device_time_us,load -> time=host_time force=load
duration,load -> time=duration force=load
duration,t,load -> time=t force=load
t,linearAcceleration-x,linear_accel_y,LinearAccZ ->
    time=t acceleration_xyz=linearAcceleration-x,linear_accel_y,LinearAccZ
time_s,t,load -> force=load
time_s,force_n[0],force_n[1] ->
t,time,load -> time=t force=load
Stamp.Sec,Stamp.Nanosec -> time=Stamp.Sec time_fraction=Stamp.Nanosec
tv_usec,tv_sec -> time=tv_sec time_fraction=tv_usec
time,nsec,load -> time=time force=load
nsec,load -> time=nsec force=load
t,force_n,fx,fy,fz -> time=t
t,O_T_EE_12,O_T_EE_13 -> time=t
load,actual_TCP_force_0,actual_TCP_force_1,actual_TCP_force_2 ->
    force_xyz=actual_TCP_force_0,actual_TCP_force_1,actual_TCP_force_2
t,qw,quat_x,orientationY,quaternionZ ->
    time=t orientation_w=qw orientation_x=quat_x orientation_y=orientationY
    orientation_z=quaternionZ
t,qx,qy,qz -> time=t
t,q_wxyz -> time=t orientation=q_wxyz
t,quat -> time=t
t,wrench.force.X -> time=t force_xyz=wrench.force.X,0,0
t,arm/F/z,arm/w/z -> time=t force_xyz=0,0,arm/F/z
t,linear_acceleration.y,angular_velocity.y -> time=t acceleration_xyz=0,linear_acceleration.y,0
t,p.ip.x,p.ip.z -> time=t position_xyz=p.ip.x,0,p.ip.z
t,top.x,cap.x -> time=t
t,rot.x,rot.y,rot.z,rot.W -> time=t
t,pose.position.x,orientation.x,torque.x -> time=t position_xyz=pose.position.x,0,0
t,rot.w,rot.x -> time=t
t,acc.x,acc.w -> time=t acceleration_xyz=acc.x,0,0
t,stamp.x,vel.x -> time=t
t,force[0],force[1],force[2] -> time=t force=force
t,acc(0),acc(1),acc(2) -> time=t acceleration=acc
/imu.linear_acceleration,/w.a.force,/w.torque,/tool.translation ->
    acceleration=/imu.linear_acceleration force=/w.a.force position_xyz=/tool.translation,0,0
/rig.t,/rig.pos,/rig.acc,/rig.v,/force -> position_xyz=/rig.pos,0,0 acceleration=/rig.acc
/rig.fz,/joints.position.elbow -> force_xyz=0,0,/rig.fz
time_ms,acc_m_s2 -> time=time_ms acceleration=acc_m_s2
time_N,fx_n -> force_xyz=fx_n,0,0
t,fx_mm,pos_g,x_n -> time=t
timeStamp,forceNewton -> time=timeStamp force=forceNewton
Time,x,Time,Fz -> position_time=Time.1 force_time=Time.2 position_xyz=x,0,0 force_xyz=0,0,Fz
X[s],x,X[s],Fz -> position_time=X.1 force_time=X.2 position_xyz=x,0,0 force_xyz=0,0,Fz
x,Time,Fz,Time,note -> force_time=Time.1 position_xyz=x,0,0 force_xyz=0,0,Fz
Time,v,Time,Fz,stamp ->
    time=stamp speed=v position_time=Time.1 force_time=Time.2 force_xyz=0,0,Fz
x,x,t,Fz -> time=t position_xyz=x.1,0,0 force_xyz=0,0,Fz
time.1,x -> position_xyz=x,0,0
t,acc 2,acc 0,acc 1,F3 -> time=t acceleration_xyz=acc 0,acc 1,acc 2
t,acc1,acc2 -> time=t
t,force,force1,force2 -> time=t force=force
t,gyro.x,gyro.y,gyro.z -> time=t
Time: ms,Force: mN -> time=Time: ms force=Force: mN
t,imu.Rotation.X -> time=t
t,Rotation.X,Position.X,Position.X -> time=t position_xyz=Position.X.1,0,0
desired.t,desired.pos,real.t,real.pos -> time=real.t position_xyz=real.pos,0,0
t,/cmd/wrench.force.z,wrench.force.z -> time=t force_xyz=0,0,wrench.force.z
t,target.force -> time=t force=target.force
t,obs.robot0_eef_pos,ee_force -> time=t force=ee_force position_xyz=obs.robot0_eef_pos,0,0
t,cursor_position.y,joint_position -> time=t position_xyz=0,cursor_position.y,0
Latest: Time,Latest: X-axis acceleration,Y Force ->
    time=Latest: Time acceleration_xyz=Latest: X-axis acceleration,0,0 force_xyz=0,Y Force,0
trial1.t,trial1.force,trial2.t,trial2.force,trial2.acc ->
    time=trial2.t force=trial2.force acceleration=trial2.acc
Run 1: Time,Run 1: Force,Run 2: Time,Run 2: Force -> time=Run 1: Time force=Run 1: Force
a1.b1.force,a1.b2.acc,a1.b2.force,a2.b1.force,a2.b1.acc,t ->
    time=t acceleration=a1.b2.acc force=a1.b2.force
log.force{1},log.t{1},log.force{2} -> time=log.t{1} force=log.force{1}
arm0.acc,arm1.force,t -> time=t acceleration=arm0.acc force=arm1.force
t,ati.x,ati.y,ati.z,adxl.x,adxl.y,adxl.z ->
    time=t force_xyz=ati.x,ati.y,ati.z acceleration_xyz=adxl.x,adxl.y,adxl.z
t,loadcell,tip.x,tip.y -> time=t force=loadcell position_x=tip.x position_y=tip.y position_z=0
"""
"""Names of columns -> TARGET=COLUMN as proposed, below if long; force_xyz=a,b,c is three axes."""


@pytest.mark.parametrize("case", re.split(r"\n(?=\S)", NAMES.strip()))
def test_columns_are_proposed_by_their_names(tmp_path, case):
    names, _, expected = case.partition(" ->")
    axes = r"\1_x=\2 \1_y=\3 \1_z=\4"
    expected = re.sub(r"\n +", " ", expected.strip())
    expected = re.sub(r"(\w+)_xyz=(.*?),(.*?),(.*?)(?= \w+=|$)", axes, expected)
    proposed = propose(str(table(tmp_path, names))).options.columns
    assert proposed == dict(re.findall(r"(\w+)=(.*?)(?= \w+=|$)", expected))


@pytest.mark.parametrize(
    ("name", "target"),
    [("Accelerometer", "acceleration_y"), ("force", "force_y"), ("a", "position_y"),
     ("Gyroscope", None), ("TotalAcceleration", "acceleration_y"), ("Gravity", None),
     ("AccelerometerUncalibrated", "acceleration_y")],
)  # fmt: skip
def test_a_bare_axis_is_one_of_what_its_file_is_called_by(tmp_path, name, target):
    columns = propose(table(tmp_path, "t,y").rename(tmp_path / f"{name}.csv")).options.columns
    assert [each for each, column in columns.items() if column == "y"] == (
        [target] if target else []
    )


FORMS = {"force_{}_n": None, "f{}": "f{}", "tip.force.{}": "tip.force.{}"}
"""What an axis of force may be called, and what is proposed for it; None if nothing has to be."""


@given(st.fixed_dictionaries({axis: st.sampled_from(["", *FORMS]) for axis in "xyz"}), st.data())
def test_nought_is_proposed_only_for_an_axis_without_a_column(tmp_path_factory, forms, data):
    names = {axis: form.format(axis) for axis, form in forms.items() if form}
    doubled = data.draw(st.sampled_from(["", *names]))
    header = ",".join(["t", *names.values(), *([names[doubled]] if doubled else [])])
    expected = {"time": "t"}
    for axis, form in forms.items():
        own = FORMS[form].format(axis) if form and FORMS[form] else None
        if axis == doubled:
            expected[f"force_{axis}"] = f"{names[axis]}.1"
        elif own or not form:
            expected[f"force_{axis}"] = own or "0"
    if {name for target, name in expected.items() if target != "time"} <= {"0"}:
        expected = {"time": "t"}  # standard names alone, or none
    assert propose(table(tmp_path_factory.mktemp("a"), header)).options.columns == expected


@pytest.mark.parametrize("form", ["{}_{}", "{}[{}]", "{}({})", "{}.{}", "{}"])
@pytest.mark.parametrize(
    ("name", "channel", "first", "unit"),
    [
        ("actual_TCP_pose", "position", 0, "m"),
        ("actual_TCP_force", "force", 0, "N"),
        ("O_F_ext_hat_K", "force", 0, "N"),
        ("actual_tool_accelerometer", "acceleration", 0, "m/s2"),
        ("O_T_EE", "position", 12, "m"),
        ("wrench", "force", 0, "N"),
        ("log.ft", "force", 0, "N"),
        ("arm/force_torque", "force", 0, "N"),
        ("/state.o_f_ext_hat_k", "force", 0, "N"),
    ],
)
def test_what_robots_call_their_measurements_has_their_unit(
    tmp_path, form, name, channel, first, unit
):
    elements = [form.format(name, first + place) for place in range(3)]
    names = list(dict.fromkeys(elements))
    vectors = [TIMES, [f"[{'0 ' * 16}]"] * len(TIMES)] if form == "{}" else ()
    path = table(tmp_path, ",".join(["t", *names]), *vectors)
    proposed = propose(path).options
    mapped = [f"{name}[{first + place}]" for place in range(3)] if form == "{}" else elements
    axes = zip([f"{channel}_{axis}" for axis in "xyz"], mapped, strict=True)
    assert proposed.columns == {"time": "t", **dict(axes)}
    assert proposed.units == {channel: unit}
    other = {channel: f"m{unit}"}
    assert propose(path, ImportOptions(units=other)).options.units == other
    told = table(tmp_path, ",".join(["t", *(f"{each} [{unit}]" for each in names)]))
    assert propose(told).options.units == {}


@pytest.mark.parametrize(
    ("names", "options", "lacking"),
    [
        ("Fz", {}, ("time", "position", "acceleration")),
        ("n,load,tip,acc", {"rate_hz": 100.0}, ()),
        ("t,v", {}, ("force", "acceleration")),
        ("/w.force", {}, ("position", "acceleration")),
        ("n,load", {"columns": {"force_time": "n"}}, ("position", "acceleration")),
        ("time_s,force_x_n,force_y_n,force_z_n", {}, ("position", "acceleration")),
        ("time_s,force_n[0],force_n[1]", {}, ("position", "acceleration")),
    ],
)
def test_what_no_column_was_found_for_is_said(tmp_path, names, options, lacking):
    proposal = propose(table(tmp_path, names), ImportOptions(**options))
    assert proposal.lacking == lacking
    assert list(proposal.names) == names.split(",")


def test_given_options_count_more_than_what_is_guessed(tmp_path):
    path = table(tmp_path, "t,Fz,n\nb,load,c", *[TIMES] * 3)
    options = ImportOptions({"time": "n", "force_x": "-Fz"}, {"time": "us"}, header=1)
    proposed = propose(path, options).options
    expected = {"time": "n", "force_x": "-Fz", "force_y": "0", "force_z": "Fz"}
    assert (proposed.columns, proposed.units) == (expected, {"time": "us"})
    with pytest.raises(InputError, match=r"--sheet is for \.xlsx: leave it out"):
        propose(path, ImportOptions(sheet="1"))


def stepped(*steps, start=0.0):
    return np.cumsum([start, *steps]).tolist()


@pytest.mark.parametrize(
    ("name", "times", "unit"),
    [
        *(("t", stepped(*[step] * 9), None) for step in (0.001, 0.05, 6e7)),
        *(("t", stepped(*[step] * 9), "ms") for step in (0.06, 50)),
        *(("t", stepped(*[step] * 9), "us") for step in (51, 5e4)),
        *(("t", stepped(*[step] * 9), "ns") for step in (5.1e4, 5e7)),
        ("t", stepped(1, 1, 1, 300), "ms"),
        ("t", stepped(0, 0, 0, 300), "us"),
        ("t", [7.0], None),
        *(("t", stepped(*[s] * 9, start=45_000), "d") for s in (1e-8, -1e-8)),
        *(("t", stepped(*[s] * 9, start=45_000), None) for s in (1e-3, 0.0)),
        ("t", stepped(*[-1] * 9), "ms"),
        ("t", stepped(*[1e-8] * 9, start=19_000), None),
        *(("t", stepped(*[1e4] * 9, start=start), "100ns") for start in (6.387e17, 1.338e17)),
        ("t", stepped(*[40] * 9, start=1.7e15), "us"),
        ("t", stepped(*[2e4] * 9, start=1.7e18), "ns"),
        *((name, stepped(*[1] * 9), None) for name in ("t_us", "t [us]")),
        ("time_s", stepped(*[1] * 9), "ms"),
        ("nsec,sec", stepped(*[1] * 9), None),
    ],
)
def test_a_unit_of_time_is_proposed_by_the_steps(tmp_path, name, times, unit):
    path = table(tmp_path, f"{name},load", *[times] * (name.count(",") + 2))
    assert propose(path).options.units == ({"time": unit} if unit else {})
    given = ImportOptions(units={"time": "min"})
    assert propose(path, given).options.units == {"time": "min"}


def test_a_unit_of_a_channels_own_time_is_proposed(tmp_path):
    path = table(tmp_path, "n,load", stepped(*[1] * 9), stepped(*[0.1] * 9))
    own = propose(path, ImportOptions({"force_time": "n"}))
    assert own.options.units == {"time": "ms"}
    assert propose(path, ImportOptions(rate_hz=10.0)).options.units == {}


@pytest.mark.parametrize(
    ("name", "given", "told", "expected"),
    [
        ("pose.position.x", {}, (), {"acceleration": "g", "position": "m"}),
        ("tf/translation/x", {}, ("acceleration",), {"position": "m"}),
        ("x", {}, (), {"acceleration": "g"}),
        (
            "pose.position.x",
            {"position": "cm", "time": "ms"},
            (),
            {"acceleration": "g", "position": "cm", "time": "ms"},
        ),
    ],
)
def test_units_are_those_in_which_gravity_and_a_hand_are_known(name, given, told, expected):
    still = ChannelReport("force", 9, 1e3, 0.0, 0, (0.0,) * 3, (9.0, 9.0, 9.0), (9.0,) * 3)
    lying = ChannelReport("acceleration", 9, 1e3, 0.0, 0, (0.0,) * 3, (0.6, 0.0, 0.8), (1.0,) * 3)
    report = ImportReport((still, lying), 0.1, (), frozenset(told))
    proposal = Proposal([], ImportOptions({"position_x": name}, given), (), SourceColumns({}))
    assert proposal.weighed(report).options.units == expected
    unmoved = ImportReport((still,), None, ())
    assert proposal.weighed(unmoved).options.units == given


@pytest.mark.parametrize(
    ("path", "command"),
    [
        ("my run.csv", "'my run.csv' 'my run.mcap' --map time=t --blanks-as-gaps"),
        ("a.MCAP", "a.MCAP a-imported.mcap --map time=t --blanks-as-gaps"),
    ],
)
def test_the_command_that_imports_is_said(path, command):
    options = ImportOptions({"time": "t"}, blanks_as_gaps=True)
    proposal = Proposal([], options, (), SourceColumns({}))
    assert proposal.command(Path(path)) == f"mmt session import {command}"


def test_rows_with_blanks_are_left_out_if_that_is_all_that_prevents_the_import(tmp_path):
    lying = ["1.01" if n % 2 else "0.99" for n in range(40)]
    cells = [*TIMES[:9], "", *TIMES[10:]]
    for force, blank in ((TIMES, False), (cells, True)):
        proposal = propose(table(tmp_path, "t,Fz,az", TIMES, force, lying))
        tried, report, error = try_proposal(tmp_path / "a.csv", proposal)
        assert error is None
        assert [each.rows for each in report.channels] == [40 - blank, 40]
        assert tried.options.blanks_as_gaps == blank
        assert tried.options.units == {"acceleration": "g"}
    back = [*TIMES[:20], *TIMES[18:38]]
    proposal = propose(table(tmp_path, "Time,x,Time,Fz", TIMES, cells, back, TIMES))
    tried, report, error = try_proposal(tmp_path / "a.csv", proposal)
    assert (tried, report) == (proposal, None)
    assert "position_x is empty or NaN in line 11" in str(error)


@pytest.mark.parametrize(
    ("arrays", "rate_hz"),
    [
        ({"fs": 500}, 500.0),
        ({"Fs": np.array([[2e3]])}, 2000.0),
        ({"acc_sampling_rate_hz": 1250.0}, 1250.0),
        ({"f_sample": 800.0, "t": np.arange(40) / 100}, None),
        ({"rate": 0.0}, None),
        ({"freq": np.inf}, None),
        ({"rate": np.arange(40.0)}, None),
        ({"rate": "high"}, None),
        ({"fs": 500, "rate": 250}, None),
        ({"offset": 500}, None),
    ],
)
def test_a_rate_beside_arrays_without_times_is_proposed(tmp_path, arrays, rate_hz):
    path = tmp_path / "a.npz"
    np.savez(path, force=np.ones((40, 3)), **arrays)
    assert propose(path).options.rate_hz == rate_hz
    assert propose(path, ImportOptions(rate_hz=77.0)).options.rate_hz == 77.0


@pytest.mark.parametrize(("columns", "whole"), [(3, True), (6, False), (7, False)])
def test_the_vector_at_the_beginning_of_wider_arrays_is_proposed(tmp_path, columns, whole):
    path = tmp_path / "a.npz"
    arrays = {n: np.random.default_rng(1).random((40, columns)) for n in ("tip", "wrench", "imu")}
    np.savez(path, t=np.arange(40) / 1000, **arrays)
    frames = import_recording(path, propose(path).options)[0].frames
    np.testing.assert_allclose(frames["force_n"], arrays["wrench"][:, :3], rtol=1e-6)
    given = {"position": "tip", "force": "wrench", "acceleration": "imu"}
    kept = propose(path, ImportOptions(given)).options.columns
    assert {target: kept.get(target) for target in given} == given
    notes = propose(path).columns.notes
    assert any("first three of the" in each for each in notes) != whole


@pytest.mark.parametrize("columns", [3, 6, 7])
@pytest.mark.parametrize("names", [("tip", "wrench", "imu"), ("pos", "force", "acc")])
def test_arrays_that_begin_with_their_time_are_proposed_with_it(tmp_path, columns, names):
    path, time_s = tmp_path / "a.npz", np.arange(40) / 1000
    arrays = {n: np.random.default_rng(1).random((40, columns)) for n in names}
    np.savez(path, **{n: np.column_stack([time_s, values]) for n, values in arrays.items()})
    proposal = propose(path)
    assert proposal.options.columns["force_time"] == f"{names[1]}[0]"
    assert len(proposal.columns.notes) == 3
    frames = import_recording(path, proposal.options)[0].frames
    np.testing.assert_allclose(frames["force_n"], arrays[names[1]][:, :3], rtol=1e-6)


@pytest.mark.parametrize("header", ["wann;Fz", "Fz;__index_level_0__"])
def test_the_first_column_or_the_index_is_the_time_if_it_holds_dates(tmp_path, header):
    path, options = tmp_path / "a.csv", ImportOptions(separator=";")
    for date, expected in (("2026-01-31 23:59:0", header.replace("Fz", "").strip(";")), ("", None)):
        rows = [(f"{date}{time}", time) for time in TIMES]
        rows = rows if header.startswith("wann") else [row[::-1] for row in rows]
        path.write_text("\n".join([header, *map(";".join, rows)]), encoding="utf-8")
        assert propose(path, options).options.columns.get("time") == expected


@pytest.mark.parametrize(
    ("unit", "target"), [("N", "force"), ("mN", "force"), ("g", "acceleration"), ("um", "position")]
)
@pytest.mark.parametrize("owner", ["", "chip.", "fin/ger."])
def test_a_bare_axis_is_one_of_what_its_unit_is_of(tmp_path, unit, target, owner):
    names = [f"{owner}X", f"{owner}y"]
    others = f"mag.x [{unit}],torque.x [{unit}]"
    head = ",".join(["t", *(f"{name} [{unit}]" for name in names), others])
    columns = propose(table(tmp_path, head, TIMES, TIMES, TIMES, TIMES, TIMES)).options.columns
    expected = zip((f"{target}_{axis}" for axis in "xyz"), [*names, "0"], strict=True)
    assert columns == {"time": "t", **dict(expected)}


@pytest.mark.parametrize(
    ("names", "options", "said"),
    [
        (
            "t,a.force,b.acc,b.force,c.force",
            {},
            ["force is proposed as a.force; by the name it may also be b.force or 1 more"],
        ),
        (
            "t,fx,fy,force_y,fz,force_z,ax,ax",
            {},
            ["force_y is proposed as fy; by the name it may also be force_y"],
        ),
        ("t,a.force,b.force", {"force": "b.force"}, []),
        ("t,time,a.force,f", {}, []),
    ],
)
def test_a_column_that_others_might_replace_is_said(tmp_path, names, options, said):
    notes = propose(table(tmp_path, names), ImportOptions(options)).columns.notes
    assert [note for note in notes if "proposed" in note] == said


@pytest.mark.parametrize(
    ("elements", "names"),
    [
        ([{"x": 1, "sensor": "acc"}, {"sensor": "force", "x": 2}], ["acc", "force"]),
        ([{"child_frame_id": "tip"}, {"child_frame_id": "arm"}], ["tip", "arm"]),
        ([{"frame_id": "tip"}, {"frame_id": "arm"}], ["0", "1"]),
        ([{"sensor_id": 3}, {"sensor_id": 5}], ["3", "5"]),
        ([{"name": 3}, {"name": 5}], ["0", "1"]),
        ([{"sensor": 0.5}, {"sensor": 1.5}], ["0", "1"]),
        ([{"x": 3}, {"x": 5}], ["0", "1"]),
        ([{"sensor": "acc"}, {"sensor": "acc"}], ["0", "1"]),
        ([{"sensor": "acc"}, {}], ["0", "1"]),
        ([], []),
    ],
)
def test_elements_of_a_list_are_called_as_they_call_themselves(elements, names):
    assert names_of(elements) == names


@pytest.mark.parametrize(
    ("names", "kept", "chosen"),
    [
        ("t demo_0.force demo_0.pos demo_1.force demo_1.pos demo_1.accel", "0 3 4 5", ["demo_1"]),
        ("t demo_0.force demo_0.pos demo_1.force demo_1.pos", "0 1 2", ["demo_0"]),
        ("run.force{1} run.force{2} run.pos{1} run.pos{2}", "0 2", ["run{1}"]),
        ("a.run.force{1} a.run.force{2}", "0", ["a.run{1}"]),
        ("log.run{2}.force log.run{1}.force", "0", ["log{2}"]),
        ("s1.d2.force s1.d3.force s2.d2.force s2.d3.force s2.d3.pos", "3 4", ["s2", "s2.d3"]),
        ("demo_0.force demo_1.pos", "0 1", []),
        ("demo_0.x demo_1.x", "0 1", []),
        ("demo_0.light demo_1.light", "0 1", []),
    ],
)
def test_columns_of_one_trial_are_proposed(names, kept, chosen):
    names = names.split()
    expected = [f"of 2 groups that hold the same, {each} is proposed" for each in chosen]
    found, notes = of_one_trial(names)
    assert found == [names[int(place)] for place in kept.split()]
    assert notes == [f"{each}, no other's columns" for each in expected]


@pytest.mark.parametrize(
    ("name", "stem", "known"),
    [
        ("X", "Acceleration", "Acceleration.X"),
        ("z", "Magnetometer_2", "Magnetometer_2.z"),
        ("y", "run", "y"),
        ("xy", "force", "xy"),
    ],
)
def test_a_bare_axis_has_its_files_name(name, stem, known):
    assert of_file(name, stem) == known


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("/robot.log.force", "force"),
        ("/robot.a.b", None),
        ("a in force", None),
        ("f in the z axis", None),
        ("force in N", "force"),
    ],
)
def test_a_name_is_known_by_its_last_part(name, target):
    assert target_of(name) == target
