"""Compiled code on disk: found again by another process, made again when any code of it changes, and no need of it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import affmap.compiled

MODULE = """
from affmap.compiled.jit import compiled
from affmap.compiled.callee import number

@compiled
def fill(array):
    array[:] = number()
"""
CALLEE = """
from affmap.compiled.jit import inlined

@inlined
def number():
    return {}
"""
PROGRAM = """
import numpy as np
from affmap.compiled.caller import fill
array = np.zeros(3)
fill(array)
print(array[0], sum(fill.stats.cache_hits.values()) if fill._cache.cache_path else None)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package `affmap` that holds the machinery and two functions, one of which calls the other."""
    folder = tmp_path / "affmap" / "compiled"
    folder.mkdir(parents=True)
    (tmp_path / "affmap" / "__init__.py").touch()
    (folder / "__init__.py").touch()
    shutil.copy(Path(affmap.compiled.__file__).parent / "jit.py", folder)
    (folder / "caller.py").write_text(MODULE)
    (folder / "callee.py").write_text(CALLEE.format(1.0))
    return tmp_path


def run(package: Path, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_another_process_finds_it(package: Path) -> None:
    assert run(package) == "1.0 0"
    assert run(package) == "1.0 1"


def test_changed_code_in_another_file_is_compiled_again(package: Path) -> None:
    """numba itself looks at the file of the function only."""
    assert run(package) == "1.0 0"
    # A longer file: Python takes one of the same second and length for the old one.
    (package / "affmap" / "compiled" / "callee.py").write_text(CALLEE.format(22.0))
    assert run(package) == "22.0 0"


def test_a_damaged_file_is_compiled_again(package: Path) -> None:
    run(package)
    for path in package.rglob("*.nbi"):
        path.write_bytes(b"")
    assert run(package).startswith("1.0")


def test_no_folder_to_write_to(package: Path, tmp_path: Path) -> None:
    """Each process compiles for itself. Files stand where folders should be, as root may write anywhere."""
    (package / "affmap" / "compiled" / "__pycache__").write_text("")
    blocked = tmp_path / "blocked"
    blocked.write_text("")
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"), str(blocked))
    assert run(package, PYTHONDONTWRITEBYTECODE="1", **homes) == "1.0 None"


@pytest.mark.parametrize(("value", "enabled"), [("1", "False"), ("0", "True")])
def test_numba_s_own_switch_is_respected(value: str, enabled: str) -> None:
    """`NUMBA_DISABLE_JIT=1`, with which people debug, leaves the work to PyTorch."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": value}
    command = [sys.executable, "-c", "from affmap import compiled; print(compiled.enabled())"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == enabled
