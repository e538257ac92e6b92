"""The command `affmap-score`: score an agent between chance, 0, and the true physics, 1, under a protocol."""

import shlex
import sys
import time
from argparse import Namespace
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.table import Table

from affmap.cli.app import command
from affmap.cli.parser import Parser
from affmap.cli.tables import console
from affmap.control import arguments
from affmap.control.agent import Agent, seeds_of
from affmap.control.controller import Controller
from affmap.control.mpc import PlanningAgent
from affmap.control.pretrained import experiments, load
from affmap.control.protocol import Protocol
from affmap.control.scoring import configured, load_protocol, references
from affmap.control.settings import GUIDES
from affmap.progress import reported
from affmap.results import leaderboard
from affmap.results.numbers import counted, estimate, number
from affmap.settings import ConfigError, extensions, names
from affmap.settings.messages import format_value, printable
from affmap.store.provenance import circumstances, without_paths
from affmap.threads import limited

PURPOSE = "score an agent between chance, 0, and the true physics, 1."

EXAMPLES = """\
  affmap-score mine:Agent   what Agent() of mine.py in this folder returns: any controller
  affmap-score mine:Agent --output runs/scores/mine
  affmap-score random
  affmap-score exp5 --context-size 32 --planner cem --guide time_to_go
  affmap-score exp6 --transition split
  affmap-score runs/exp1"""


def main() -> None:
    """Run the command `affmap-score`."""
    parser = Parser("affmap-score", PURPOSE, EXAMPLES)
    known = ", ".join(experiments())
    parser.add_argument(
        "source",
        help="module:function, a file of conf/agent, a report's folder, that of a saved agent, or one of " + known,
    )
    parser.add_argument("--context-size", type=int, help="units of the models' codes (default: 8)")
    parser.add_argument("--transition", help="such as split of exp6 (default: the first there is)")
    parser.add_argument("--planner", help="cem or gradient (default: that of the experiment)")
    parser.add_argument("--guide", choices=GUIDES, help="sub-goals on the way (default: that of the experiment)")
    parser.add_argument("--protocol", default="eight_worlds", help="a file of conf/protocol (default: eight_worlds)")
    parser.add_argument("--name", help="of the agent, in tables (default: its source and kind)")
    parser.add_argument("--output", type=Path, help="folder to keep the runs in (default: they are not kept)")
    line = ["affmap-score", *without_paths(sys.argv[1:])]
    given = parser.take()
    command(lambda _: _score(given, shlex.join(line)), resumes=False)


def _score(given: Namespace, line: str) -> None:
    if given.name is not None and not given.name.strip():
        raise ConfigError("--name is empty; give the agent a name, or leave it out.")
    protocol = load_protocol(given.protocol)
    if given.output:
        leaderboard.check_folder(arguments.folder(given.output))
    agent = _agent(given, protocol)
    name, begun = _name(given.source, agent) if given.name is None else given.name, time.perf_counter()
    with limited(1), extensions.blamed(given.source, "flying") if _is_own(given.source) else nullcontext():
        runs = protocol.fly(agent, reported)
    members, rules = len(seeds_of(agent)), {"name": protocol.name, "digest": protocol.digest}
    if given.output:  # first, so that it is kept whatever comes; and the oracle need not fly again for its own score
        seconds = round(time.perf_counter() - begun, 1)
        record = {"agent": name, "members": members, "protocol": rules, "seconds": seconds, **circumstances()}
        _keep(given, runs, {**record, "command": line})
    table = leaderboard.scores(runs, *references(protocol), protocol.control.num_steps)
    flown = f"{counted(members, 'member')}, {protocol.num_runs} runs in each world"
    print(f"{printable(name)}: {flown} of {protocol.name} ({protocol.digest})")
    console().print(_table(table))
    if missing := [world.name for world in protocol.worlds if world.name not in {*runs["world"]}]:
        print(f"The agent has not learned the channels of {', '.join(missing)}, and so has no mean.")
    if given.output:
        print(f"The runs are kept in {given.output}")


def _keep(given: Namespace, runs: pd.DataFrame, record: dict[str, Any]) -> None:
    """Write runs and their record; and, for an agent of a module in the current folder, that one's file."""
    if not _is_own(given.source):
        leaderboard.write(given.output, runs, record)
        return
    module = given.source.partition(":")[0]
    record = {**record, "extensions": [extensions.origin(module)]}
    leaderboard.write(given.output, runs, record, extensions.own_files(module))


def _is_own(source: str) -> bool:
    """Whether the source of an agent is `module:function`."""
    return ":" in source


def _agent(given: Namespace, protocol: Protocol) -> Controller:
    """The agent of a command line.

    Raises:
        ConfigError: there is none, or a flag is for other agents.
    """
    source: str = given.source
    choices = {key: getattr(given, key) for key in ("context_size", "transition", "planner")}
    chosen = [f"--{key.replace('_', '-')}" for key, value in choices.items() if value is not None]
    is_trained = not _is_own(source) and source not in names("agent")
    if chosen and not is_trained:
        raise ConfigError(f"{chosen[0]} chooses among trained agents, and {source} is none; leave it out.")
    agent: Any
    if _is_own(source):
        agent = extensions.make(source)
        if not arguments.is_agent(agent):
            raise ConfigError(
                f"{source} returned {format_value(agent)}, which is no agent; let it return an object with the methods "
                "initial and act."
            )
    elif is_trained:
        agent = load(source, members="all", **choices)
    else:
        agent = configured(source, protocol)
    if given.guide is not None:
        if not isinstance(agent, PlanningAgent):
            raise ConfigError(f"--guide {given.guide} is for agents that plan, and {source} does not; leave it out.")
        agent.settings = agent.settings.model_copy(update={"guide": given.guide})
    return agent


def _name(source: str, agent: Controller) -> str:
    """The name of an agent in tables: its source and, if it plans, its model, its planner and its guide."""
    if not isinstance(agent, PlanningAgent) or _is_own(source):
        return source
    stack = agent.stack if isinstance(agent, Agent) else None
    model = [f"C = {stack.context_size}", stack.settings.transition_name] if stack else []
    guide = [] if agent.settings.guide == "none" else [agent.settings.guide]
    return ", ".join([source, *model, getattr(agent.planner, "kind", type(agent.planner).__name__), *guide])


def _table(scores: pd.DataFrame) -> Table:
    """A row for each world, and one for their mean."""
    rows = Table("world", box=SIMPLE_HEAD, pad_edge=False)
    for head in ("score [95 % interval]", "success", "mean distance (u)"):
        rows.add_column(head, justify="right")
    for row in scores.to_dict("records"):
        score = estimate(row["score"], row["low"], row["high"])
        rows.add_row(row["world"], score, number(row["success"]), number(row["mean_distance"]))
    return rows
