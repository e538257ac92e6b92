"""Circumstances of a result: versions, git state, machine, command, cost; records with a checksum of their own."""

import hashlib
import json
import os
import platform
import re
import resource
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from affmap.settings import extensions

PROVENANCE = "provenance.json"
"""File of a stage and of a report."""

PACKAGES = ("affmap", "torch", "lightning", "numpy", "numba", "box2d", "gymnasium", "hydra-core", "pandas", "scipy")

NUMERIC = ("torch", "lightning", "numpy", "numba", "box2d")
"""Packages whose version may change a result's numbers. The package's own rules are versioned stage by stage."""

_CHECKSUM = "checksum"

_PATH = re.compile(r"^/|=.*(?<![^\s=\[{(,:'\"\\])(~[\w.-]*/|file:|(?!(?<=:)//)/\S)", re.DOTALL)
"""A path from the root or somebody's home: at the beginning, or in a value, after anything but a name or `https:`."""


def canonical(value: Any) -> str:
    """The canonical JSON text of a plain value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def circumstances() -> dict[str, Any]:
    """The circumstances of a result besides its configuration: command, versions, git state, machine."""
    # Settings of Hydra's for the names and the logs of jobs say nothing of a result, either.
    arguments = [each for each in without_paths(sys.argv[1:]) if not each.lstrip("+").startswith("hydra.job")]
    return {
        "command": shlex.join([Path(sys.argv[0]).name, *arguments]),
        "versions": versions(),
        "git": _git(),
        "machine": {"system": platform.system(), "processor": platform.machine(), "cores": os.cpu_count()},
    }


def extensions_of(config: Mapping[str, Any]) -> dict[str, Any]:
    """The entry `extensions`: the origins of everything in a configuration that is not of this package; else none."""
    origins = extensions.origins(config)
    return {"extensions": origins} if origins else {}


def versions() -> dict[str, str | None]:
    """Package -> its installed version."""
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def other_versions(recorded: Mapping[str, str | None]) -> str:
    """A list of differences between recorded and installed versions of numeric packages; empty where there are none.

    A package that is not recorded did not matter to the result's numbers.
    """
    now = versions()
    names = [name for name in NUMERIC if name in recorded and recorded[name] != now[name]]
    return ", ".join(f"{name} {recorded[name]} instead of {now[name]}" for name in names)


def with_checksum(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with a checksum of its other entries."""
    rest = {key: value for key, value in record.items() if key != _CHECKSUM}
    return {**rest, _CHECKSUM: hashlib.sha256(canonical(rest).encode()).hexdigest()}


def has_valid_checksum(record: Mapping[str, Any]) -> bool:
    """Whether a record's checksum is that of its other entries."""
    try:
        return with_checksum(record) == record
    except (ValueError, RecursionError):  # NaN, or nested more deeply than any of ours
        return False


def without_paths(arguments: Sequence[str]) -> list[str]:
    """A command line's arguments without those that hold a path on this machine, which says nothing of a result."""
    return [argument for argument in arguments if not has_path(argument)]


def has_path(argument: str) -> bool:
    """Whether an argument, or a part of its value such as an element of a list, is an absolute path or one from `~`.

    A key may begin with `~`, which removes it from a configuration.
    """
    return bool(_PATH.search(argument))


def peak_memory() -> float:
    """Peak memory of this process so far, MiB."""
    try:  # on Linux `ru_maxrss` starts from the parent's
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
    """The commit of the code, `-dirty` if it was changed since; None outside a checkout."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        result = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    except OSError:  # no git on this machine
        return None
    return result.stdout.strip() or None
