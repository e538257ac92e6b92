"""Real sweeps at the tiniest scale, run by the real command.

Every job is in a process forked from one that has imported everything, so that a run takes a second.
"""

import multiprocessing
import os
import resource
import sys
from collections.abc import Sequence
from multiprocessing.context import ForkServerProcess
from pathlib import Path

LINE = [
    "scale=smoke",
    "members=1",
    "data.num_sequences=4",
    "data.num_validation=1",
    "data.num_steps=12",
    "training.num_epochs=4",
    "training.snapshot_epochs=[2]",
    "control.num_steps=3",
    "planner.num_iterations=1",
    "report.map_spacing=0.5",
    "lookup.spacing=0.5",
    "model.context_size=0,1",
    "hydra.launcher.n_jobs=1",
]
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(
    [  # the last two, because Hydra takes the folder tests/hydra_plugins for plugins
        *("affmap.cli.run", "affmap.pipeline.execution", "affmap.training.fit", "affmap.compiled.gradients"),
        *("affmap.compiled.search", "affmap.control.imagination", "hydra_plugins.hydra_joblib_launcher._core"),
        *("hydra_plugins.hyperopt_sweeper.hyperopt_sweeper", "hyperopt", "joblib", "pytest", "hypothesis"),
    ]
)


def line(folder: Path) -> list[str]:
    return [*LINE, f"store={folder / 'store'}", f"reference={folder / 'reference'}", f"output={folder / 'output'}"]


def affmap(folder: Path, overrides: Sequence[str], limit: int | None) -> None:
    """The command, in a process of its own; no file may be longer than `limit` bytes."""
    from affmap.cli import run

    os.setsid()
    output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    sys.argv = ["affmap", *line(folder), *overrides]
    run.main()


def start(folder: Path, *overrides: str, limit: int | None = None) -> ForkServerProcess:
    folder.mkdir(exist_ok=True)
    process = CONTEXT.Process(target=affmap, args=(folder, overrides, limit))
    process.start()
    return process


def finish(process: ForkServerProcess) -> int:
    """The exit status; after ten minutes even a busy machine that compiles all loops first is done."""
    process.join(600)
    assert process.exitcode is not None, "it goes on and on"
    return process.exitcode


def said(folder: Path) -> str:
    return (folder / "output.txt").read_text()


def results(folder: Path) -> dict[str, bytes]:
    """Every file of the store that holds results: all but locks, of which a kill at the very end leaves one, and where
    they come from, which tells of times."""
    files = [
        path for path in sorted(folder.glob("store/*/*/**/*")) if path.is_file() and path.name != "provenance.json"
    ]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def undisturbed_sweep(folder: Path) -> Path:
    """The folder of a sweep that nothing happened to."""
    assert finish(start(folder)) == 0, said(folder)
    assert len(results(folder)) == 1 * 2 + 2 * 4 + 2 * 2 + 2 * 1 + 2 * 3
    return folder
