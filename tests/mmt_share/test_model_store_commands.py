"""`mmt model push`, `pull` and `list --from`: a lab's library on another machine."""

from asyncio import to_thread
from pathlib import Path

from command_runs import output_of, refusal, run_json
from sharing_samples import shared

from mmt.core.errors import MmtError

MODEL = Path("configs/models/plastic.npz").resolve()


PUSH, PULL, LIST = (("model", name) for name in ("push", "pull", "list"))


async def test_a_model_is_pushed_listed_and_pulled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    async with shared(store=str(tmp_path / "store"), accept=True) as sharing:
        about = ("--name", "a/b", "--licence", "CC0")
        await to_thread(output_of, *PUSH, MODEL, "--to", sharing.url, *about)
        (entry,), _ = await to_thread(run_json, tmp_path, *LIST, "--from", sharing.url)
        assert (entry["name"], entry["licence"]) == ("a/b", "CC0")
        pull = (*PULL, "a/b", "--from", sharing.url)
        await to_thread(output_of, *pull)
        assert (tmp_path / "a-b.npz").read_bytes() == MODEL.read_bytes()
        assert "--force replaces it" in await to_thread(refusal, *pull)


def test_mistakes_are_sentences(tmp_path):
    (tmp_path / "text.npz").write_text("no model")
    assert "No such file" in refusal(*PUSH, tmp_path / "no", "--to", "http://x")
    assert "not a texture model" in refusal(*PUSH, tmp_path / "text.npz", "--to", "http://x")
    nobody = refusal(*LIST, "--from", "http://127.0.0.1:9", kind=MmtError)
    assert "http://127.0.0.1:9 does not answer" in nobody
