"""The notebook of the documentation, run as it stands."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[2] / "docs/how-to/first-model.ipynb"


@pytest.mark.filterwarnings("ignore::DeprecationWarning:zmq")
def test_the_notebook_runs_and_each_of_its_outputs_shows_something(tmp_path):
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    shown = [len(cell.outputs) for cell in notebook.cells if cell.cell_type == "code"]
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [len(cell.outputs) for cell in cells] == shown
    for cell in cells:
        for output in cell.outputs:
            data = output.get("data", {})
            text = output.get("text", "") or data.get("image/png", "")
            assert text.strip(), f"{cell.source}: an output without content"
            assert output.get("name") != "stderr", output
