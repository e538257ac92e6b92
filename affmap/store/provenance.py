"""Circumstances of a result: versions, git state, machine, command, cost; records with a checksum of their own."""

import hashlib
import json
import os
import platform
import resource
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

PROVENANCE = "provenance.json"
"""File of a stage and of a report."""

PACKAGES = ("affmap", "torch", "lightning", "numpy", "numba", "box2d", "gymnasium", "hydra-core", "pandas", "scipy")

NUMERIC = ("torch", "lightning", "numpy", "numba", "box2d")
"""Packages whose version may change a result's numbers. Our own rules have versions of their own, a stage each."""

_CHECKSUM = "checksum"


def canonical(value: Any) -> str:
    """The one JSON text of a plain value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def circumstances() -> dict[str, Any]:
    """What a result comes from besides its configuration: command, versions, git state, machine."""
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *without_places(sys.argv[1:])]),
        "versions": versions(),
        "git": _git(),
        "machine": {"system": platform.system(), "processor": platform.machine(), "cores": os.cpu_count()},
    }


def versions() -> dict[str, str | None]:
    """Package -> its installed version."""
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def other_versions(made_with: Mapping[str, str | None]) -> str:
    """How the packages that numbers depend on differ from those installed, in words; empty where they do not.

    A package that is not named is none that the result's numbers depended on.
    """
    now = versions()
    different = [name for name in NUMERIC if name in made_with and made_with[name] != now[name]]
    return ", ".join(f"{name} {made_with[name]} instead of {now[name]}" for name in different)


def with_checksum(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with a checksum of all the rest."""
    rest = {key: value for key, value in record.items() if key != _CHECKSUM}
    return {**rest, _CHECKSUM: hashlib.sha256(canonical(rest).encode()).hexdigest()}


def has_valid_checksum(record: Mapping[str, Any]) -> bool:
    """Whether a record has the checksum of its other entries."""
    return with_checksum(record) == record


def without_places(arguments: Sequence[str]) -> list[str]:
    """A command line's arguments but for absolute places on this machine, which say nothing of a result."""
    return [argument for argument in arguments if "=/" not in argument]


def peak_memory() -> float:
    """Largest memory of this process so far, MiB."""
    try:  # on Linux `ru_maxrss` begins with what the parent process had
        status = Path("/proc/self/status").read_text("utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) / 2**10
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


@cache
def _version(package: str) -> str | None:
    try:
        return version(package)
    except ModuleNotFoundError:  # box2d is called box2d-py on some platforms
        return None


def _git() -> str | None:
    """The commit that the code comes from, `-dirty` if it was changed since; None outside a checkout."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        result = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    except OSError:  # no git on this machine
        return None
    return result.stdout.strip() or None
