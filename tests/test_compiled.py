from pathlib import Path

import pytest

from mmt.core.compiled import kernel
from mmt.core.kernel_cache import drop_stale_kernels, kernels_are_compiled


def test_a_kernel_needs_a_signature() -> None:
    with pytest.raises(ValueError, match="signature"):
        kernel()


def test_kernels_are_dropped_when_any_source_of_their_folder_changes(tmp_path: Path) -> None:
    source = tmp_path / "numerics.py"
    source.write_text("one")
    assert drop_stale_kernels(tmp_path)
    compiled = tmp_path / "__pycache__" / "other.nbi"
    compiled.touch()
    assert not drop_stale_kernels(tmp_path)
    assert compiled.exists()
    source.write_text("two")
    assert drop_stale_kernels(tmp_path)
    assert not compiled.exists()


def test_what_was_imported_is_compiled() -> None:
    import mmt.texture.interpolation.delaunay  # noqa: F401

    assert kernels_are_compiled()
