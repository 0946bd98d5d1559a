"""Files are written whole or not at all, and an end of descriptors ends in a sentence."""

import subprocess
import sys
from pathlib import Path

import pytest
from sharing_samples import model_of

from mmt.core.errors import InputError, MmtError
from mmt.texture.model.texture_model import TextureModel


def test_a_model_replaces_another_when_it_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, first = tmp_path / "oak.npz", model_of(10).to_bytes()
    model_of(10).save(path)
    write = Path.write_bytes

    def break_off(self: Path, data: bytes) -> int:
        write(self, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", break_off)
        for target in (path, tmp_path / "new.npz"):
            with pytest.raises(MmtError, match="No space left on device"):
                model_of(12).save(target)
    assert path.read_bytes() == first
    assert [each.name for each in tmp_path.iterdir()] == ["oak.npz"]
    model_of(12).save(path)
    assert len(TextureModel.load(path).samples) == 12
    with pytest.raises(InputError, match="cannot write"):
        model_of(10).save(tmp_path / "nowhere" / "oak.npz")


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limit")
def test_too_few_descriptors_end_in_a_sentence() -> None:
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (12, 12)); "
        "sys.argv[1:] = ['scene', 'explain', 'demo', '--measure']; "
        "from mmt.cli.entry import mmt; mmt()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", limited], capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 1
    assert "error: too many files are open: raise the limit" in ended.stderr
    assert "Traceback" not in ended.stderr
