"""The help of the command `affmap`: short without arguments, and with the files that overrides choose for `--help`."""

import textwrap
from collections.abc import Iterable

from affmap.config.explain import groups, options
from affmap.settings import names

ABOUT = """\
affmap: run the incomplete jobs of a sweep, or the missing trials of a search.

usage: affmap OVERRIDE ...
       affmap FOLDER [OVERRIDE ...]

examples:
  affmap experiment=exp1                             an experiment: several jobs, one on each core
  affmap experiment=exp1 scale=smoke                 the same at toy size
  affmap planner=cem,gradient model.context_size=8   a sweep of your own
  affmap runs/exp1                                   resume the sweep that was run into runs/exp1
  affmap search=training                             a search for hyperparameters

affmap-status shows the progress, affmap-report shows and draws the results.
"""

SHORT = f"{ABOUT}`affmap --help` lists what can be overridden; `affmap name=single` runs the defaults, at full size."
"""The answer to a command without arguments: hours of work are rarely meant by that."""

OVERRIDES = """\
An override is key=value, or group=file with a file of conf/group; key=1,2,3 makes a job of each value. A folder
stands for the overrides of the sweep that was run into it. A job that was interrupted resumes.

Groups of several files:
"""

MORE = """\
`affmap experiment=exp1 --cfg job` prints all keys with their values in a job, and runs nothing; the documentation
explains each (docs/settings.md). `affmap --hydra-help` lists Hydra's own flags, `affmap --version` tells versions."""


def text() -> str:
    """The text of `--help`."""
    files = {group: options(group) for group in groups()}
    of_groups = "".join(_wrapped(f"{group}: ", each) for group, each in files.items() if len(each) > 1)
    layouts = f"Layouts, which keys such as world and control_layout name:\n{_wrapped('', names('layout'))}"
    return "\n".join([ABOUT, f"{OVERRIDES}{of_groups}", layouts, MORE])


def _wrapped(head: str, files: Iterable[str]) -> str:
    """A paragraph of names."""
    lines = textwrap.wrap(f"{head}{', '.join(files)}", 106, break_on_hyphens=False)
    return textwrap.indent("\n  ".join(lines), "  ") + "\n"
