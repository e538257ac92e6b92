"""Work on a card: the same results as on the CPU, then the times of training, planning and the whole paper on both.

`python tests/benchmarks/gpu.py [--output FOLDER] [--device cpu] [--toy]` needs a build of torch for CUDA, and less than
8 minutes: measurements have fixed lengths. Exploration, maps and reports always run on the CPU and are not timed.
"""

import json
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import checks
import machine
import pandas as pd
import paper
import torch
from graphs import Epoch, Training, captured
from rich.console import Console
from tables import plain_table
from workloads import (
    FULL,
    TOY,
    Scale,
    batches,
    cpu_training,
    first_observation,
    fly,
    generators,
    make_agent,
    synchronize,
)

from affmap import compiled
from affmap.config.root import Config
from affmap.control.agent import Agent
from affmap.data.batches import Batch

EXPERIMENT = "exp5"
"""Whose trainings are timed: the longest ones, of all context sizes."""

PLAIN, GRAPH, TOGETHER = "plain", "CUDA graph", "CUDA graphs side by side"
"""Ways to work on the card."""

CPU = "CPU, compiled loops"
"""How affmap works without a card; on one thread of the same machine."""

BURST = 10
"""Calls that a card gets at once, before it is waited for."""


class Timing(NamedTuple):
    """How long something takes."""

    work: str
    contender: str
    unit: str
    seconds: float
    """Of a unit."""
    timed: int
    """Units that were timed; 0: computed from other rows."""


class Stopwatch(NamedTuple):
    """Times calls on a device for a fixed time each."""

    device: str
    seconds: float

    def time(self, work: str, contender: str, unit: str, run: Callable[[], object]) -> Timing:
        """The time of a call of `run`, which does a unit of the work; a burst of calls warms up."""
        self._burst(run)
        count, begin = 0, time.perf_counter()
        while (passed := time.perf_counter() - begin) < self.seconds:
            self._burst(run)
            count += BURST
        return Timing(work, contender, unit, passed / count, count)

    def _burst(self, run: Callable[[], object]) -> None:
        for _ in range(BURST):
            run()
        synchronize(self.device)


@compiled.switched(False)
def main() -> None:
    """Compare the device with PyTorch on the CPU, time it beside compiled loops, print and write.

    Raises:
        SystemExit: the device's results are not those of the CPU.
    """
    arguments, progress = parse(), Console(stderr=True)
    torch.set_num_threads(1)
    scale, device, output = TOY if arguments.toy else FULL, arguments.device, arguments.output
    output.mkdir(parents=True, exist_ok=True)
    (output / "machine.json").write_text(json.dumps(machine.describe(), indent=2) + "\n", encoding="utf-8")
    jobs, watch = paper.jobs(scale.overrides), Stopwatch(device, scale.seconds)
    configs = paper.trainings(job for job in jobs if job.name == EXPERIMENT)
    own = batches(configs[0], scale)
    progress.print("Comparing with the CPU")
    compared = [*checks.training(configs[-1], own, device), *checks.control(scale, device)]
    write(compared, output / "checks.csv")
    timings: list[Timing] = []
    parts = {
        "training": lambda: training(configs, own, watch),
        "planning": lambda: planning(scale, watch),
        "control": lambda: control(scale, device),
        "the whole paper": lambda: whole_paper(jobs, timings),
    }
    for name, part in parts.items():
        progress.print(f"Timing: {name}")
        timings += part()
        write(timings, output / "gpu.csv")
    console = Console(width=None if sys.stdout.isatty() else 120)
    for rows in (compared, timings):
        console.print(plain_table(pd.DataFrame(rows)))
    console.print(f"Written to {output}")
    if wrong := [check.check for check in compared if not check.difference <= check.allowed]:
        raise SystemExit(f"{device} and the CPU differ by more than rounding: {'; '.join(wrong)} (checks.csv).")


def write(rows: Sequence[NamedTuple], path: Path) -> None:
    """Write a table."""
    pd.DataFrame(rows).to_csv(path, index=False, float_format="%.6g")


def parse() -> Namespace:
    """The command line."""
    parser = ArgumentParser("gpu", description="Check and time affmap on an NVIDIA card; torch must be built for CUDA.")
    parser.add_argument("--output", type=Path, default=Path("runs/gpu"), help="folder to write to (%(default)s)")
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda", help="what is timed (%(default)s)")
    parser.add_argument("--toy", action="store_true", help="all at toy size; the numbers mean nothing")
    arguments = parser.parse_args()
    if arguments.device == "cuda" and not torch.cuda.is_available():
        parser.error(
            f"torch {torch.__version__} finds no card; install a build of torch for CUDA that the card's driver can "
            "run, or try everything but the card with --device cpu --toy."
        )
    return arguments


def training(configs: Sequence[Config], own: Sequence[Batch], watch: Stopwatch) -> list[Timing]:
    """Updates of a stack of each context size, and of all of them at the same time."""
    epoch = Epoch.of(own, watch.device)
    replays, timings = [], []
    for config in configs:
        replays.append(captured(Training(config, epoch)))
        contenders = {PLAIN: Training(config, epoch).update, GRAPH: replays[-1], CPU: cpu_training(config, own)}
        timings += [watch.time(_work(config), contender, "update", run) for contender, run in contenders.items()]

    def update_all() -> None:
        for replay in replays:
            replay()

    return [*timings, watch.time("training, all context sizes", TOGETHER, "update of each", update_all)]


def _work(config: Config) -> str:
    return f"training, context size {config.model.context_size}"


def planning(scale: Scale, watch: Stopwatch) -> list[Timing]:
    """Plans by the cross-entropy method, from a cold start."""
    timings = []
    for runs in scale.runs:
        for contender, device in ((PLAIN, watch.device), (CPU, "cpu")):
            with compiled.switched(contender == CPU):
                agent = make_agent(scale, runs, "cem", device)
                own = generators(agent)
                plan = partial(agent.act, first_observation(agent), agent.initial(len(own)), own)
                timings.append(watch.time(f"planning, {len(own)} agents", contender, "plan of each", plan))
    return timings


def control(scale: Scale, device: str) -> list[Timing]:
    """Steps of flights by either planner: plans, and environments on the CPU."""
    timings = []
    for planner in ("cem", "gradient"):
        for contender, where in ((PLAIN, device), (CPU, "cpu")):
            with compiled.switched(contender == CPU):
                timings.append(_flight(contender, planner, make_agent(scale, scale.runs[0], planner, where)))
    return timings


def _flight(contender: str, planner: str, agent: Agent) -> Timing:
    ends: list[float] = []
    fly(agent, lambda _: ends.append(time.perf_counter()))
    num_steps = len(ends) - 1  # the first one warmed up
    return Timing(f"control, {planner}", contender, "step of each", (ends[-1] - ends[0]) / num_steps, num_steps)


def whole_paper(jobs: Sequence[Config], timings: Sequence[Timing]) -> list[Timing]:
    """The time that all trainings and flights of the paper would take; those that experiments share count once.

    Batches are taken to be ready on the device; and side by side, all trainings to gain as much as those timed.
    """
    seconds = {(timing.work, timing.contender): timing.seconds for timing in timings}

    def trainings(contender: str) -> float:
        return sum(paper.updates(job) * seconds[_work(job), contender] for job in paper.trainings(jobs))

    def flights(contender: str) -> float:
        return sum(job.control.num_steps * seconds[f"control, {job.controller}", contender] for job in flown)

    flown = paper.flights(jobs)
    alone, together = (
        sum(timing.seconds for timing in timings if timing.contender == contender) for contender in (GRAPH, TOGETHER)
    )
    side_by_side = trainings(GRAPH) * together / alone
    parts = {
        f"trainings, {PLAIN}": trainings(PLAIN),
        f"trainings, {GRAPH}": trainings(GRAPH),
        f"trainings, {TOGETHER}": side_by_side,
        f"trainings, {CPU}": trainings(CPU),
        f"flights, {PLAIN}": flights(PLAIN),
        f"flights, {CPU}": flights(CPU),
        f"both, {TOGETHER}, then {PLAIN}": side_by_side + flights(PLAIN),
        f"both, {CPU}": trainings(CPU) + flights(CPU),
    }
    return [Timing("the whole paper", part, "paper", spent, 0) for part, spent in parts.items()]


if __name__ == "__main__":
    main()
