"""`mmt model push`, `pull` and `list --from`: a lab's library on another machine."""

import asyncio
import json
from pathlib import Path

import pytest
from sharing_samples import shared
from typer.testing import CliRunner, Result

from mmt.cli.main import app
from mmt.core.errors import MmtError

MODEL = Path("configs/models/plastic.npz").resolve()


async def run(*arguments: object) -> Result:
    return await asyncio.to_thread(CliRunner().invoke, app, ["model", *map(str, arguments)])


async def test_a_model_is_pushed_listed_and_pulled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        pushed = await run("push", MODEL, "--to", sharing.url, "--name", "a/b", "--licence", "CC0")
        assert pushed.exit_code == 0, pushed.output
        listed = await run("list", "--from", sharing.url, "--json", tmp_path / "list.json")
        assert listed.exit_code == 0, listed.output
        (entry,) = json.loads((tmp_path / "list.json").read_text())
        assert (entry["name"], entry["licence"]) == ("a/b", "CC0")
        pulled = await run("pull", "a/b", "--from", sharing.url)
        assert pulled.exit_code == 0, pulled.output
        assert (tmp_path / "a-b.npz").read_bytes() == MODEL.read_bytes()
        again = await run("pull", "a/b", "--from", sharing.url)
        assert again.exception is not None
        assert "--force replaces it" in str(again.exception)


async def test_mistakes_are_sentences(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no model")
    missing = await run("push", tmp_path / "no", "--to", "http://x")
    assert "No such file" in str(missing.exception)
    wrong = await run("push", tmp_path / "text.npz", "--to", "http://x")
    assert "not a texture model" in str(wrong.exception)
    nobody = await run("list", "--from", "http://127.0.0.1:9")
    assert isinstance(nobody.exception, MmtError)
    assert "http://127.0.0.1:9 does not answer" in str(nobody.exception)
