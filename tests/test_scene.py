from pathlib import Path

import pytest

from mmt.core.errors import InputError
from mmt.scene import PART_TABLES, Scene
from mmt.scene.files import environment_overrides, load_scene, scene_from_tables, scene_of_recording
from mmt.scene.leader_tables import TEXTURE_TABLE, Texture
from mmt.texture.settings import CriterionScale, ModellingSettings

CONFIGS = sorted((Path(__file__).parents[1] / "configs").glob("*.toml"))
SIMULATED = {"link": {}, "simulated": {}, "hand": {}, "recording": {}}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_example_scene_is_valid(path):
    scene = load_scene(path)
    assert scene_from_tables(scene.dump()) == scene


def test_every_part_concerns_a_service():
    scene = Scene()
    assert set(PART_TABLES) == {*scene.parts("leader"), *scene.parts("follower")}
    assert set(scene.parts()) == set(PART_TABLES) == set(Scene.model_fields) - {"session"}


def test_a_part_runs_in_the_services_that_its_values_ask_for():
    tables = {**SIMULATED, "force_feedback": {"method": "streamed"}}
    assert "force_feedback" not in scene_from_tables(tables).parts("follower")
    tables["force_feedback"] = {"method": "passive"}
    assert scene_from_tables(tables).parts("follower")["force_feedback"]


def textured(**keys):
    return {**SIMULATED, "texture": keys}


def limited(**keys):
    return {**SIMULATED, "simulated": keys}


def rendered(texture=None, **keys):
    tables = {**SIMULATED, "texture": {} if texture is None else texture}
    return {**tables, "playout": {}, "actuator": {}, "rendering": keys}


def fed_back(**keys):
    return {**SIMULATED, "force_feedback": keys}


WRONG = [
    ({"linkk": {}}, ["linkk", "allowed are", "link"]),
    ({"link": {"prt": 1}}, ["link.prt", "allowed are", "port"]),
    ({"link": {"port": 70000}}, ["link.port", "70000", "65535"]),
    ({"link": 3}, ["link", "3"]),
    ({"session": {"rate_hz": 500}}, ["session.rate_hz", "1000"]),
    ({"session": {"duration_s": float("nan")}}, ["session.duration_s", "finite"]),
    (textured(order=99), ["order", "99", "equal to 64"]),
    (textured(order="some"), ["texture.order", "'some'"]),
    (textured(axis="w"), ["texture.axis", "dft321"]),
    (textured(normal="y"), ["surface across z", "leave 'normal'"]),
    (textured(method="published", stop_distance=9.0), ["stop_distance must not exceed"]),
    (textured(level="interpolated"),
     ['level = "interpolated": no longer a choice; write method = "published"']),
    (textured(method="custom", interpolator="rbf"),
     ['interpolator = "rbf" and method = "custom": no', 'write method = "field"']),
    (textured(selection={"largest": 50}), ["selection: no longer a table", "leave it out"]),
    (textured(method="published", start_share=0.5),
     ['start_share is of method "field"', "write start_distance and stop_distance"]),
    (textured(start_distance=9.0),
     ['start_distance is of method "published", and method is "field"']),
    (textured(stop_share=0.5), ["stop_share is 0.5", "start_share 0.65"]),
    (textured(start_share=1.0), ["texture.start_share"]),
    ({**SIMULATED, "hand": {"fastest_mm_s": 10.0}}, ["fastest_mm_s", "slowest_mm_s"]),
    (limited(workspace_mm=[[0, 0, 0], [1, 0, 1]]),
     ["simulated", "workspace_mm reaches from 0 to 0 mm along y", "lowest corner first"]),
    (limited(workspace_mm=[[0, 0], [1, 1, 1]]),
     ["simulated.workspace_mm.0.2 is missing", "should be 'off'"]),
    (limited(acceleration_limit_mm_s2=0),
     ["simulated.acceleration_limit_mm_s2 is 0: ", "equal to 100, or 'off'"]),
    ({"texture": {}}, ["[texture]", "add [link]"]),
    ({"network": {}, "hand": {}}, ["[network] needs a follower: add [link]"]),
    ({"link": {}, "texture": {}}, ["source", "[simulated], [replay], [devices]"]),
    ({**SIMULATED, "replay": {}}, ["[simulated] and [replay]", "keep one"]),
    ({"link": {}, "simulated": {}, "recording": {}}, ["[simulated]", "add [hand]"]),
    ({"link": {}, "replay": {}, "hand": {}, "recording": {}}, ["remove [hand]"]),
    ({"link": {}, "replay": {}, "handle": "a:B", "recording": {}}, ["remove [handle]"]),
    ({**SIMULATED, "handle": {"driver": "a:B"}}, ["[hand] and [handle]", "keep one"]),
    ({**SIMULATED, "playout": {}, "actuator": {"port": 1}}, ["port", "driver", "limit_m_s2"]),
    ({**SIMULATED, "handle": {"port": "x"}}, ["handle.driver"]),
    ({**SIMULATED, "playout": {}}, ["add [actuator]"]),
    ({"hand": {}, "rendering": {}, "actuator": {}}, ["needs a model"]),
    (rendered(before="silent", model="felt"), ["renders its model from the start"]),
    (rendered(before="later"), ["rendering.before", "stream"]),
    (rendered(before="warm"), ["no longer a choice", "write start_share = 0.5"]),
    (rendered(library=["felt"]), ["library: no longer a key", "leave it out"]),
    (rendered(update_fade_ms=500.0), ["update_fade_ms: no longer a key", "leave it out"]),
    (rendered(texture={"surfaces": {}}, model="m.npz"), ["keeps one for each surface"]),
    (rendered(texture={"surfaces": {}}, generator="band"), ["from the strokes on one surface"]),
    ({"hand": {}, "actuator": {}, "rendering": {"model": "felt", "generator": "band"}},
     ["learns from the strokes on one surface"]),
    ({"hand": {}, "actuator": {}, "rendering": {"model": "felt"}, "metrics": {}},
     ["[metrics] needs a follower: add [link]"]),
    ({"rendering": {"model": "m.npz"}, "actuator": {}}, ["add [hand], [handle] or [link]"]),
    ({"link": {}, "simulated": {}, "hand": {}}, ["would carry nothing"]),
    ({"link": {}, "replay": {}, "recording": {}, "force_feedback": {}},
     ["[force_feedback]", "add [hand]"]),
    (fed_back(method="streamed", reserve_mj=2.0), ["reserve_mj has no meaning with method"]),
    (fed_back(method="model", largest_drift_mm=1.0), ["largest_drift_mm has no meaning with"]),
    (fed_back(method="passive", largest_stiffness_n_mm=5.0),
     ["largest_stiffness_n_mm has no meaning with method"]),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "words"), WRONG)
def test_a_wrong_scene_names_key_value_and_what_is_allowed(tables, words):
    with pytest.raises(InputError, match=r"^my\.toml: ") as caught:
        scene_from_tables(tables, origin="my.toml")
    assert [word for word in words if word not in str(caught.value)] == []


def test_files_that_are_no_scene(tmp_path):
    with pytest.raises(InputError, match=r"no such file; the examples are anisotropic, demo"):
        load_scene(tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    bad.write_bytes(b"[link\n")
    with pytest.raises(InputError, match="not valid TOML"):
        load_scene(bad)
    bad.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not valid TOML: byte 1 is no UTF-8; save it as UTF-8"):
        load_scene(bad)


def test_a_scene_with_the_mark_of_windows_editors_is_read(tmp_path):
    (tmp_path / "marked.toml").write_text("[session]\r\nseed = 7\r\n", "utf-8-sig")
    assert load_scene(tmp_path / "marked.toml").session.seed == 7


def test_only_the_channels_that_the_scene_needs():
    def channels(tables):
        return scene_from_tables({"link": {}, "simulated": {}, "hand": {}, **tables}).channels()

    assert channels({"playout": {}, "actuator": {}}) == ("acceleration",)
    assert channels({"force_feedback": {}}) == ("force",)
    assert channels({"texture": {}}) == ("position", "force", "acceleration")
    assert channels({"recording": {}}) == ("position", "force", "acceleration")
    assert channels({"recording": {"channels": "needed"}}) == channels({"recording": {}})
    assert channels({"force_feedback": {}, "recording": {"channels": "needed"}}) == ("force",)
    assert len(channels({"force_feedback": {}, "recording": {}})) == 3
    assert Scene().channels() == ()


def test_flags_override_the_environment_which_overrides_the_file(tmp_path, monkeypatch):
    path = tmp_path / "scene.toml"
    path.write_text("[link]\nport = 1\n[simulated]\n[hand]\n[recording]\n[session]\nseed = 5\n")
    monkeypatch.setenv("MMT_LINK__PORT", "2")
    monkeypatch.setenv("MMT_SESSION__NAME", "from-environment")
    scene = load_scene(path, {"link.port": 3, "session.duration_s": None})
    found = scene.link.port, scene.session.name, scene.session.seed
    assert found == (3, "from-environment", 5)
    assert environment_overrides({"MMT_LINK__PORT": "2", "PATH": "x", "MMT_HOME": "y"}) == {
        "link.port": "2"
    }


def test_lists_come_from_the_environment_as_toml(monkeypatch):
    monkeypatch.setenv("MMT_SIMULATED__WORKSPACE_MM", "[[-1, -2, -3], [1, 2, 3]]")
    scene = load_scene(Path("demo"))
    assert scene.simulated.workspace_mm == ((-1, -2, -3), (1, 2, 3))
    for text in ("[::1]", "[1, 2", "[" * 100_000):  # a host, and what is no list
        assert environment_overrides({"MMT_LINK__HOST": text}) == {"link.host": text}
    monkeypatch.setenv("MMT_SIMULATED__WORKSPACE_MM", "a.npz")
    with pytest.raises(InputError, match=r"MMT_SIMULATED__WORKSPACE_MM: .*'a.npz': "):
        load_scene(Path("demo"))


@pytest.mark.parametrize("before", ["stream", "silent"])
def test_what_is_played_before_the_model_decides_whether_the_vibration_is_streamed(before):
    assert scene_from_tables(rendered(before=before)).streams == (before == "stream")


def test_replay_takes_the_place_of_follower_and_hand():
    scene = load_scene(CONFIGS[0].with_name("demo.toml"), replay=Path("x.mcap"))
    assert (scene.source, scene.replay.file) == ("replay", Path("x.mcap"))
    assert scene.hand is scene.force_feedback is None


def test_examples_are_found_by_name_and_files_beside_the_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_scene(Path("demo")).session.name == "demo"
    scene_file = tmp_path / "scenes" / "mine.toml"
    scene_file.parent.mkdir()
    scene_file.write_text('[hand]\n[actuator]\n[rendering]\nmodel = "m.npz"\n')

    def model():
        rendering = load_scene(scene_file).rendering
        return rendering.model if rendering else None

    assert model() == Path("m.npz")
    (scene_file.parent / "m.npz").touch()
    assert model() == scene_file.parent / "m.npz"
    (tmp_path / "m.npz").touch()
    assert model() == Path("m.npz")


def test_to_record_a_run_does_not_change_its_wire(tmp_path):
    plain = load_scene(Path("stream-only"))
    recorded = load_scene(Path("stream-only"), record=tmp_path / "a.mcap")
    assert recorded.recording.file == tmp_path / "a.mcap"
    assert recorded.channels() == plain.channels() == ("force", "acceleration")
    demo = load_scene(Path("demo"), record=tmp_path / "a.mcap").recording
    assert demo.channels == "all"


def test_a_variable_emulates_a_network_in_any_scene():
    variables = environment_overrides({"MMT_NETWORK__PROFILE": "wan", "MMT_NETWORK__LOSS": "0.5"})
    scene = scene_from_tables(SIMULATED, variables)
    assert (scene.network.delay_ms, scene.network.loss) == (40.0, 0.5)
    assert scene_from_tables(scene.dump()) == scene


@pytest.mark.parametrize(
    ("name", "conceal", "expected"),
    [
        ("demo", "auto", "model"),
        ("stream-only", "auto", "repetition"),
        ("stream-only", "model", "model"),
        ("demo", "silence", "silence"),
        ("model-only", None, "silence"),
    ],
)
def test_gaps_are_concealed_from_a_model_where_the_numerics_are_there_anyway(
    name, conceal, expected
):
    scene = load_scene(Path(name), {"playout.conceal": conceal})
    assert scene.concealment == expected


@pytest.mark.parametrize("method", ["streamed", "passive", "model"])
def test_a_resolved_scene_of_each_method_is_read_again(method):
    tables = {"link": {}, "simulated": {}, "hand": {}, "force_feedback": {"method": method}}
    scene = scene_from_tables(tables)
    assert scene_from_tables(scene.dump()) == scene
    assert ("position" in scene.channels()) == (method == "model")


@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_one_key_models_as_published(inputs):
    made = scene_from_tables(textured(method="published", inputs=inputs)).texture
    assert made.settings() == ModellingSettings(method="published", inputs=inputs)
    assert made.scale == CriterionScale("distance", "completion sum", *made.distances, rises=False)
    dumped = TEXTURE_TABLE.dump_python(made, mode="json")
    assert scene_from_tables(textured(**dumped)).texture == made


FORMER = {"start_distance": "auto", "stop_distance": 4.0, "start_share": 0.5, "stop_share": 0.9}
FIELD = {"method": "field", "start_share": 0.5, "stop_share": 0.9}


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (
            {"level": "gaussian_process", "shape": "smoothed", "criterion": "uncertainty"},
            FIELD,
        ),
        ({"level": "gaussian_process", "shape": "measured", "criterion": "distance"}, FIELD),
        (
            {"level": "interpolated", "interpolate": "power", "interpolator": "rbf"},
            {"method": "published", "stop_distance": 4.0},
        ),
    ],
)
@pytest.mark.parametrize("method", [{}, {"method": "custom"}])
def test_the_scene_of_an_earlier_recording_is_read_by_the_nearest_method(parts, expected, method):
    tables = textured(**FORMER, **method, **parts, order=7)
    scene = scene_of_recording(tables, "a recording")
    assert scene.texture == Texture(**expected, order=7)
    assert scene_of_recording(scene.dump(), "a recording") == scene
    with pytest.raises(InputError, match="no longer a choice"):
        scene_from_tables(tables)


def test_a_recorded_scene_is_read_without_its_selection_or_named_where_it_is_wrong():
    tables = textured(order="auto", selection={"largest": 50})
    assert scene_of_recording(tables, "a recording").texture == Texture()
    for texture, said in (({"order": "some"}, "texture.order"), (3, "texture")):
        with pytest.raises(InputError, match=f"^a recording: {said}"):
            scene_of_recording({**SIMULATED, "texture": texture}, "a recording")


@pytest.mark.parametrize(
    "former", [{"before": "warm", "library": ["felt"]}, {"update_fade_ms": 1.0}]
)
def test_a_recorded_scene_with_known_textures_is_still_read(former):
    scenes = (rendered(**keys, crossfade_ms=20.0) for keys in (former, {}))
    found, expected = (scene_of_recording(tables, "a recording") for tables in scenes)
    assert found == expected


def test_a_variable_that_is_wrong_is_named_and_not_the_file(monkeypatch):
    monkeypatch.setenv("MMT_LINK__PORTT", "3")
    with pytest.raises(InputError, match=r"^environment variable MMT_LINK__PORTT: link.portt is"):
        load_scene(Path("demo"))
    monkeypatch.delenv("MMT_LINK__PORTT")
    monkeypatch.setenv("MMT_LINK__PORT", "70000")
    with pytest.raises(InputError, match=r"^environment variable MMT_LINK__PORT: link.port is"):
        load_scene(Path("demo"))
    assert load_scene(Path("demo"), {"link.port": 9000}).link.port == 9000, "a flag overrides it"


def test_an_option_that_is_wrong_is_named_and_not_the_file(monkeypatch, tmp_path):
    wrong = {"session.duration_s": -3.0}
    with pytest.raises(InputError, match=r"^--duration: session.duration_s is -3.0"):
        load_scene(Path("demo"), wrong, options={"session.duration_s": "--duration"})
    with pytest.raises(InputError, match=r"^overrides: session.duration_s is -3.0"):
        load_scene(Path("demo"), wrong)
    monkeypatch.setenv("MMT_SESSION__NAME", "a/b")
    file = tmp_path / "scene.toml"
    file.write_text("[link]\nport = 70000\n[simulated]\n[hand]\n[recording]\n")
    with pytest.raises(InputError) as caught:
        load_scene(file, {"session.duration_s": 3.0})
    origin = f"{file} and environment variable MMT_SESSION__NAME: "
    assert str(caught.value).startswith(origin), "and not the option, which is right"


def test_the_robots_limits_are_off_only_where_the_scene_says_so():
    limits = scene_from_tables(SIMULATED).describe_motion_limits()
    assert limits.startswith("x -200 to 200, y -200 to 200, z -200 to 200 mm; 1000 mm/s; 300000 ")
    off = {"workspace_mm": "off", "acceleration_limit_mm_s2": "off"}
    scene = scene_from_tables({**SIMULATED, "simulated": off})
    assert scene.describe_motion_limits() == "any position; 1000 mm/s; any acceleration"
    assert scene_from_tables({"recording": {}, "link": {}, "replay": {}}).motion_limits is None
