"""The documentation: it builds, without network; what it says works; what it quotes is there."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import affmap

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the package where a reader may change it."""
    for name in ("affmap", "conf", "hydra_plugins"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/reference").symlink_to(ROOT / "runs/reference")
    return tmp_path


PAGES = [DOCS / "quickstart.md", *sorted(DOCS.glob("howto/*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_says_works(page: Path, checkout: Path) -> None:
    """All of its code and commands, in order, in a checkout of their own."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PYTHONPATH": str(checkout), "PATH": path, "OMP_NUM_THREADS": "1"}
    script = [sys.executable, "-W", "ignore", ROOT / "tests/pages.py", page]
    result = subprocess.run(script, cwd=checkout, env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
