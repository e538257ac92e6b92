"""The pages of the commands: purpose, from the head of a command's module, and the text of its `--help`."""

import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import import_module

from places import ROOT

from affmap.report.markdown import table

WIDTH = "78"
"""Columns of the help's text."""


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each command."""
    for name, text in helps().items():
        yield f"commands/{name}.md", f"# {name}\n\n{purpose(name)}\n\n```text\n{text.strip()}\n```\n\n{_MORE}"


_MORE = "Exit statuses and interruption are [the same for all commands](../commands.md#exit-statuses).\n"


def index() -> str:
    """A table of all commands; for a page in the folder `docs` itself."""
    return table(["command", "purpose"], [(f"[`{name}`](commands/{name}.md)", purpose(name)) for name in scripts()])


def scripts() -> dict[str, tuple[str, str]]:
    """Command -> module and function that it runs."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return {name: (entry.split(":")[0], entry.split(":")[1]) for name, entry in project["scripts"].items()}


def purpose(name: str) -> str:
    """A sentence on a command."""
    first = " ".join((import_module(scripts()[name][0]).__doc__ or "").split("\n\n")[0].split())
    text = first.removeprefix(f"The command `{name}`: ")
    return text[0].upper() + text[1:]


@cache
def helps() -> dict[str, str]:
    """Command -> the text of its `--help`."""
    environment = {**os.environ, "COLUMNS": WIDTH, "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
    running = {
        name: subprocess.Popen(
            [
                sys.executable,
                "-c",
                f"import sys; sys.argv[0] = {name!r}; from {module} import {main}; {main}()",
                "--help",
            ],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name, (module, main) in scripts().items()
    }
    texts = {name: process.communicate()[0] for name, process in running.items()}
    for name, process in running.items():
        if process.returncode:
            raise RuntimeError(f"{name} --help ends with status {process.returncode}.")
    return texts
