"""``mmt play`` on the command line."""

import asyncio
import signal
import sys
from pathlib import Path

import aiohttp
import pytest
from player_samples import flat_texture

from mmt.core.errors import InputError
from mmt_share.commands.playing import play


def given(directory, **options):
    usual = {
        "results": directory / "results.csv",
        "record": None,
        "shared": None,
        "seed": 0,
        "host": "127.0.0.1",
        "port": 0,
        "token_file": None,
        "certificate": None,
        "key": None,
        "everyone": False,
        "force": False,
    }
    return {**usual, **options}


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


async def test_the_page_is_served_until_ctrl_c(tmp_path):
    flat_texture(1.0).save(tmp_path / "cork.npz")
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "mmt.cli.entry", "main", "play", "cork.npz", "--port", "0",
        cwd=tmp_path, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    assert process.stderr is not None
    async with asyncio.timeout(120):
        while not (line := await process.stderr.readline()).startswith(b"player:"):
            assert line
        url = line.decode().split()[1]
        async with aiohttp.ClientSession() as http, http.get(url) as answer:
            assert "mmt texture player" in await answer.text()
        process.send_signal(signal.SIGINT)
        await process.stderr.read()
        assert await process.wait() == 0
