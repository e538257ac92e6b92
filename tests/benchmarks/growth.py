"""How the cost of training grows with members, context size, channels, threads and processes.

Called as a program, this module is one process of those that train next to each other (see `Process`).
"""

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Self

import pandas as pd
import torch
from flights import SETTINGS, batches, data_module, dataset
from measure import elapsed
from training import CONTEXT_SIZE, MEMBERS, make_stack, updates

from affmap.store.provenance import peak_memory
from affmap.training.module import TrainingModule

VARIED = {"members": (1, 5, 25, 125), "context_size": (0, 1, 3, 5, 8, 16, 32), "channels": (1, 2, 3, 4)}

ROUNDS = 5
"""Turns of each."""

SECONDS = 1.0
"""Of a turn of processes that train next to each other."""


def growth() -> pd.DataFrame:
    """Cost of a model and update as one thing is varied.

    Columns: varied (members, context_size, channels, or threads and processes), members, context_size, channels,
    threads (of each process), processes, milliseconds (a model and update; CPU time, but for threads and processes,
    where it is the time by the clock of all together), peak_memory_mib (of a process that only trains, for some numbers
    of members).
    """
    base = {"members": MEMBERS, "context_size": CONTEXT_SIZE, "channels": 1, "threads": 1, "processes": 1}
    rows: list[dict[str, Any]] = [
        {"varied": varied, **base, varied: value} for varied, values in VARIED.items() for value in values
    ]
    runs = [varied_updates(row["members"], row["context_size"], row["channels"]) for row in rows]
    with Process(MEMBERS, 1) as one, Process(MEMBERS, 1) as other, Process(MEMBERS, 2) as broad:
        for team in ([one], [one, other], [broad]):
            setting = {"threads": 2 if broad in team else 1, "processes": len(team)}
            rows.append({"varied": "threads and processes", **base, **setting})
            runs.append(partial(together, team))
        for row, seconds in zip(rows, in_turns(runs), strict=True):
            row["milliseconds"] = 1000 * seconds
    for row in rows:
        if row["varied"] == "members" and row["members"] in (1, 25, 125):
            with Process(row["members"], 1) as process:
                row["peak_memory_mib"] = process.train()["peak_memory_mib"]
    return pd.DataFrame(rows)


def varied_updates(members: int, context_size: int, channels: int) -> Callable[[], float]:
    """A call trains such a stack for a while and returns the seconds of a model and update."""
    own = batches(channels)[: max(4, 250 // members)]
    run = updates(make_stack(members, context_size, channels), own)
    run()
    return lambda: elapsed(run) / (members * len(own))


def together(team: "Sequence[Process]") -> float:
    """Seconds of a model and update of processes that train at the same time, all together."""
    for process in team:
        process.begin()
    return 1 / sum(process.end()["updates_per_second"] * MEMBERS for process in team)


def in_turns(runs: Sequence[Callable[[], float]]) -> list[float]:
    """The median of what each of `runs` returns when they take turns."""
    return [median(values) for values in zip(*([run() for run in runs] for _ in range(ROUNDS)), strict=True)]


class Process:
    """A process of its own that trains a stack on command."""

    def __init__(self, members: int, threads: int) -> None:
        """Start it; inside a `with` statement it is warm."""
        command = [sys.executable, __file__, str(dataset()), str(members), str(threads)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def begin(self) -> None:
        """Let it train for a while."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{SECONDS}\n")
        self._process.stdin.flush()

    def end(self) -> dict[str, float]:
        """Wait until it has: `updates_per_second` (of the stack), `peak_memory_mib`."""
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def train(self) -> dict[str, float]:
        """Both."""
        self.begin()
        return self.end()

    def __enter__(self) -> Self:
        self.train()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()  # closes its standard input, which ends it


def serve(path: Path, members: int, threads: int) -> None:
    """Be such a process: read seconds from standard input, train, write results to standard output."""
    torch.set_num_threads(threads)
    module = TrainingModule(make_stack(members, CONTEXT_SIZE), SETTINGS)
    optimizer = module.configure_optimizers()
    endless = itertools.cycle([batch for step in data_module(path).train_dataloader() for batch in step])
    for line in sys.stdin:
        begin, count = time.perf_counter(), 0
        while (passed := time.perf_counter() - begin) < float(line):
            module.update(next(endless), optimizer)
            count += 1
        print(json.dumps({"updates_per_second": count / passed, "peak_memory_mib": peak_memory()}), flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
