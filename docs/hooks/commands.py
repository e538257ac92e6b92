"""The pages of the commands: purpose, from the head of a command's module, and the text of its `--help`."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache

from api import member
from places import ROOT

from affmap.report.markdown import table

WIDTH = "78"
"""Columns of the help's text."""


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each command."""
    for name, text in helps().items():
        yield f"commands/{name}.md", f"# {name}\n\n{purpose(name)}\n\n```text\n{text.strip()}\n```\n\n{MORE}"


MORE = "Exit statuses and interruption are [the same for all commands](../commands.md#exit-statuses).\n"


def index() -> str:
    """A table of all commands; for a page in the folder `docs` itself."""
    return table(["command", "purpose"], [(f"[`{name}`](commands/{name}.md)", purpose(name)) for name in scripts()])


def scripts() -> dict[str, str]:
    """Command -> `module:function` that it runs."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]


def purpose(name: str) -> str:
    """A sentence on a command."""
    docstring = member(scripts()[name].partition(":")[0]).docstring
    assert docstring
    text = " ".join(docstring.value.split("\n\n")[0].split()).removeprefix(f"The command `{name}`: ")
    return text[0].upper() + text[1:]


@cache
def helps() -> dict[str, str]:
    """Command -> the text of its `--help`, all from one process, since torch takes seconds to import."""
    environment = {**os.environ, "COLUMNS": WIDTH, "PYTHONWARNINGS": "ignore"}
    script = [sys.executable, "-c", PRINT_HELPS, json.dumps(scripts())]
    done = subprocess.run(script, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"The commands do not print their help: {done.stderr}")
    return json.loads(done.stdout)


PRINT_HELPS = """
import contextlib, importlib, io, json, sys
texts = {}
commands = json.loads(sys.argv[1])
for name, entry in commands.items():
    module, _, main = entry.partition(":")
    sys.argv[1:], sys.argv[0] = ["--help"], name
    with contextlib.redirect_stdout(io.StringIO()) as text:
        try:
            getattr(importlib.import_module(module), main)()
        except SystemExit as end:
            if end.code:
                raise
    texts[name] = text.getvalue()
print(json.dumps(texts))
"""
