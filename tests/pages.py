"""Do what a page of the documentation says, in the folder where one is: `python tests/pages.py docs/howto/layout.md`.

In order of the page: a block that begins with a comment that is the name of a file is written to that file, a `diff` is
applied, `python` runs in one namespace, `bash` in a shell, after which Python begins anew. All other blocks are for
reading only.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple


class Block(NamedTuple):
    language: str
    text: str
    line: int
    """Of the page, the block's first."""


def blocks(page: Path) -> Iterator[Block]:
    text = page.read_text("utf-8")
    for found in re.finditer(r"^```(\w*)\n(.*?)^```$", text, flags=re.M | re.S):
        yield Block(found[1], found[2], text.count("\n", 0, found.start(2)) + 1)


FRESH = {"__name__": "__main__"}
"""Where Python begins."""


def follow(page: Path) -> None:
    namespace: dict[str, Any] = {**FRESH}
    for language, text, line in blocks(page):
        if name := re.match(r"(?:# @.+\n)?# ([\w./]+\.\w+)\n", text):
            Path(name[1]).parent.mkdir(parents=True, exist_ok=True)
            Path(name[1]).write_text(text, "utf-8")
        elif language == "diff":
            subprocess.run(["git", "apply", "-"], input=text, text=True, check=True)
        elif language == "python":
            exec(compile("\n" * (line - 1) + text, page, "exec"), namespace)
        elif language == "bash":
            subprocess.run(["bash", "-ec", text], check=True)
            namespace = {**FRESH}


if __name__ == "__main__":
    sys.path.insert(0, "")  # what has been written can be imported
    follow(Path(sys.argv[1]))
