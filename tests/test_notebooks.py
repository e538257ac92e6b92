"""The notebooks run from start to end, and show something."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="the extra [docs]: make docs")
nbclient = pytest.importorskip("nbclient", reason="the extra [docs]: make docs")
pytest.importorskip("ipykernel", reason="the extra [docs]: make docs")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    """Its pictures are as many as those that are kept in it, and nothing is said on the side."""
    notebook = nbformat.read(path, as_version=4)
    kept = [kinds(cell) for cell in notebook.cells]
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert [kinds(cell) for cell in notebook.cells] == kept and len(kept) > 10


def kinds(cell: dict) -> list[str]:
    """What a cell has put out: pictures, tables, words on one of the streams."""
    return [output.get("name") or next(iter(sorted(output["data"]))) for output in cell.get("outputs", [])]
