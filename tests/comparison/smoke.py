"""Smoke runs of a checkout: every experiment, every search and the paper, in a working folder."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import yaml

MARKER = "complete.txt"
"""Written last into a working folder: the checkout, its commit and the commands."""

Command = Sequence[str]


def commands(checkout: Path) -> list[Command]:
    """List the commands for all that a checkout has in `conf`; a `growth` runs with the experiment that names it."""
    paths = sorted((checkout / "conf" / "experiment").glob("*.yaml"))
    growths = {yaml.safe_load(path.read_text("utf-8")).get("growth") for path in paths}
    settings = [[f"experiment={path.stem}"] for path in paths if path.stem not in growths]
    for path in sorted((checkout / "conf" / "search").glob("*.yaml")):
        settings.append([f"search={path.stem}", "hydra.sweeper.num_trials=4"])
    lines = [[name, *each, "scale=smoke"] for each in settings for name in ("affmap", "affmap-report")]
    return [*lines, ["affmap-paper", "scale=smoke"]]


def run(folder: Path, checkout: Path, commands: Sequence[Command]) -> None:
    """Run the commands of a checkout in an empty working folder; leave with a message if one fails."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    start = time.monotonic()
    with (folder / "log.txt").open("w", encoding="utf-8") as log:
        for number, (name, *arguments) in enumerate(commands, start=1):
            print(f"{folder.name} {number}/{len(commands)}: {name} {' '.join(arguments)}", file=sys.stderr)
            status = subprocess.run(
                [checkout / ".venv" / "bin" / name, *arguments],
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                stdout=log,
                stderr=subprocess.STDOUT,
            ).returncode
            if status:
                sys.exit(f"{name} {' '.join(arguments)} failed with status {status}; see {log.name}")
    (folder / MARKER).write_text(_mark(checkout, commands), encoding="utf-8")
    print(f"{folder.name}: {time.monotonic() - start:.0f} s", file=sys.stderr)


def is_complete(folder: Path, checkout: Path, commands: Sequence[Command]) -> bool:
    """Whether a working folder has the results of these commands from this commit of the checkout."""
    marker = folder / MARKER
    return marker.is_file() and marker.read_text("utf-8") == _mark(checkout, commands)


def _mark(checkout: Path, commands: Sequence[Command]) -> str:
    head = subprocess.run(["git", "-C", checkout, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    return "\n".join([str(checkout), head.stdout.strip(), *map(" ".join, commands), ""])
