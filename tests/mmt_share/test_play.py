"""``mmt play`` on the command line."""

import re
import signal
import urllib.request
from pathlib import Path

import pytest
from player_samples import flat_texture
from service_processes import LONGEST_S, Service

from mmt.core.errors import InputError
from mmt_share.commands.playing import play


def given(directory, **options):
    usual = dict.fromkeys(("record", "shared", "token_file", "certificate", "key"))
    usual |= {"results": directory / "results.csv", "seed": 0, "host": "127.0.0.1", "port": 0}
    return {**usual, "everyone": False, "force": False, **options}


def test_what_cannot_be_played_is_explained(tmp_path):
    model = tmp_path / "cork.npz"
    flat_texture(1.0).save(model)
    (tmp_path / "more").mkdir()
    flat_texture(1.0).save(tmp_path / "more" / "cork.npz")
    with pytest.raises(InputError, match=r"must end in \.mcap"):
        play([model], **given(tmp_path, record=Path("touch.csv")))
    with pytest.raises(InputError, match="cork: two textures have this name"):
        play([model, tmp_path / "more" / "cork.npz"], **given(tmp_path))
    with pytest.raises(InputError, match="shipped are"):
        play([Path("nothing")], **given(tmp_path))
    with pytest.raises(InputError, match=r"lets everyone .* be the player: set a token"):
        play([model], **given(tmp_path, host="0.0.0.0"))
    with pytest.raises(InputError, match="certificate and key belong together"):
        play([model], **given(tmp_path, key=Path("key.pem")))
    (tmp_path / "results.csv").write_text("other,columns\n")
    with pytest.raises(InputError, match="name another file"):
        play([model], **given(tmp_path))


def test_the_page_is_served_until_ctrl_c(tmp_path):
    flat_texture(1.0).save(tmp_path / "cork.npz")
    with Service("main", "play", "cork.npz", "--port", 0, cwd=tmp_path) as player:
        player.wait_for(lambda: "/player/" in player.stderr)
        (url,) = re.findall(r"http://\S+", player.stderr)
        with urllib.request.urlopen(url, timeout=LONGEST_S) as answer:
            assert b"mmt texture player" in answer.read()
        player.signal(signal.SIGINT)
        assert player.end() == 0
