"""One surface, several hands: leader, follower and listeners as processes."""

import json
import signal
import socket

import pytest
from service_processes import Service, follower_of, scene
from sharing_samples import LISTENS

from mmt_share.store.store import ModelStore

SCENE = scene("demo")


def share(directory, duration_s, **variables):
    return Service(
        *("leader", SCENE, "--share", "--json-lines", "--port", 0, "--duration", duration_s),
        cwd=directory,
        MMT_SHARING__PORT="0",
        MMT_SHARING__STORE=str(directory / "store"),
        **variables,
    )


def listen(directory, url, *arguments, **variables):
    return Service(LISTENS, url, "--json-lines", *arguments, cwd=directory, **variables)


def nobody_listens(port):
    """Whether a port of this machine is free to be listened on."""
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) != 0


def shared_at(leader):
    """Wait until listeners may connect, and return where."""
    leader.wait_for(lambda: any(e.startswith("shared at ") for e in leader.events()))
    (sentence,) = (e for e in leader.events() if e.startswith("shared at "))
    return sentence.removeprefix("shared at ")


def test_two_listeners_render_the_model_while_it_grows(tmp_path):
    # the sum of distances is met at the same time whatever the surface
    with share(tmp_path, 60.0, MMT_TEXTURE__METHOD="published") as leader:
        leader.port()
        url = shared_at(leader)
        with (
            listen(tmp_path, url, "--name", "early") as early,
            follower_of(leader, "demo", tmp_path) as follower,
        ):
            leader.wait_for(lambda: any("start criterion" in e for e in leader.events()))
            with listen(tmp_path, url, "--name", "late") as late:
                for listener in (early, late):
                    listener.wait_for(
                        lambda who=listener: any("rendering the shared" in e for e in who.events())
                    )
                leader.wait_for(lambda: any("stop criterion" in e for e in leader.events()))
                leader.signal(signal.SIGINT)
                assert (leader.end(), follower.end()) == (0, 0), leader.stderr
                for listener in (early, late):
                    listener.wait_for(lambda who=listener: "has ended" in " ".join(who.events()))
                    listener.signal(signal.SIGINT)
                    assert listener.end() == 0, listener.stderr
                found = [listener.summary() for listener in (early, late)]
    sharing = leader.summary()["sharing"]
    heard = {each["name"]: each for each in sharing["listeners"]}
    for name, summary in zip(("early", "late"), found, strict=True):
        listening = summary["listening"]
        assert listening["session_id"] == leader.summary()["session"]["id"]
        assert (listening["rejected"], listening["whole_models"]) == (0, 1)
        assert listening["number"] == sharing["models"]
        assert summary["vibration"]["mode"] == "synthesized"
        assert (heard[name]["wholes"], heard[name]["changes"]) == (1, listening["changes"])
        assert heard[name]["states"] == listening["states"] > 0
        assert 0 < heard[name]["number"] <= sharing["models"]  # it is told once a second
    assert found[0]["listening"]["changes"] > 0
    assert (sharing["joined"], sharing["most_listeners"]) == (2, 2)
    assert 0.0 <= heard["early"]["lag_p50_ms"] <= heard["early"]["lag_p99_ms"]
    (entry,) = ModelStore(tmp_path / "store").entries()
    assert (entry.name, entry.samples) == ("demo", leader.summary()["texture"]["samples"])


def test_a_leader_that_returns_is_followed(tmp_path):
    """Killed, so that it says no goodbye; its process for listeners goes with it."""
    with share(tmp_path, 60.0) as leader:
        leader.port()
        url = shared_at(leader)
        with listen(tmp_path, url) as listener:
            listener.wait_for(lambda: "listening to demo" in listener.events())
            leader.signal(signal.SIGKILL)
            listener.wait_for(lambda: any("cut off" in e for e in listener.events()))
            port = url.rpartition(":")[2]
            listener.wait_for(lambda: nobody_listens(int(port)))  # it is closed after the lines
            with Service(
                *("leader", SCENE, "--share", "--json-lines", "--port", 0),
                cwd=tmp_path,
                MMT_SHARING__PORT=port,
            ) as again:
                again.port()
                shared_at(again)
                listener.wait_for(lambda: listener.events().count("listening to demo") == 2)
                again.signal(signal.SIGINT)
                again.end()
            listener.signal(signal.SIGINT)
            assert listener.end() == 0, listener.stderr


def test_a_port_that_is_taken_ends_the_session_with_a_sentence(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        with Service(
            *("leader", SCENE, "--share", "--port", 0), cwd=tmp_path, MMT_SHARING__PORT=port
        ) as leader:
            assert leader.end() == 1
    assert "the model cannot be shared: cannot listen on 127.0.0.1" in leader.stderr
    assert "set host and port of [sharing]" in leader.stderr
    assert "Traceback" not in leader.stderr


@pytest.mark.parametrize("options", [(), ("--json", "found.json")])
def test_a_listener_whose_time_is_over_says_that_it_heard_nobody(tmp_path, options):
    url = "http://127.0.0.1:9"
    with Service(LISTENS, url, "--duration", 0.2, *options, cwd=tmp_path) as listener:
        assert listener.end() == 1
        assert f"no leader was heard at {url}" in listener.stderr
        assert "Traceback" not in listener.stderr
    if options:
        found = json.loads((tmp_path / "found.json").read_text())
        assert found["outcome"] == f"failed: no leader was heard at {url}"
        assert found["listening"]["session_id"] is None
