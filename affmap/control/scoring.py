"""Agents scored under an evaluation protocol, where the oracle has 1 and an agent that acts at random 0."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from affmap.control import arguments
from affmap.control.controller import Controller
from affmap.control.pretrained import reference
from affmap.control.protocol import Protocol
from affmap.control.registry import AgentSettings, AnyAgent, OracleSettings, is_learned
from affmap.progress import reported, silent
from affmap.results import leaderboard
from affmap.settings import ConfigError, Settings, read
from affmap.settings.messages import format_value
from affmap.threads import limited

SCORES = "scores"
"""Folder of the reference run that has a folder for each published agent."""


def score(
    agents: Controller | Mapping[str, Controller],
    protocol: Protocol | str = "eight_worlds",
    *,
    progress: bool = True,
    threads: int = 1,
) -> pd.DataFrame:
    """Score agents under an evaluation protocol: the same worlds, starts, goals and noise for everyone.

    A run counts by the share of its steps that are left when it reaches the goal, without ever having been in fog, and
    else by 0. The score of a world is the mean over its runs, scaled so that the agent that acts at random has 0 and
    the oracle has 1. `affmap.results.leaderboard` has the rules, and `affmap-score` does the same in a shell.

    Args:
        agents: an agent, or several by their names in the table; any controllers, as for `affmap.fly`. The number of an
            agent's members must divide that of the runs in a world, 100.
        protocol: a file of `conf/protocol`, or a protocol. Of the published one, the runs of oracle and random agent
            are published, too; under any other they fly first, which takes minutes.
        progress: whether a terminal shows the number of steps done.
        threads: of PyTorch, during the flights.

    Returns:
        A row for each agent and world, and one for the mean of all worlds, with the columns `agent`, `protocol` (its
        digest: scores of another one cannot be compared), `world`, and those of `affmap.results.leaderboard.scores`:
        `success`, `mean_distance`, `score`, `low` and `high`. A world that an agent cannot see, because it has not
        learned its channels, has empty values.

    Raises:
        ConfigError: there is no such protocol; or it is no agent, or none of its channels; or its members cannot share
            the runs.

    Warns:
        UserWarning: an agent was trained with another vehicle.
    """
    named, rules = arguments.named(agents), load_protocol(protocol)
    if not named:
        raise ConfigError("score needs an agent, as in affmap.score(agent).")
    show = reported if progress else silent
    with limited(threads):
        flown = {name: rules.fly(agent, show) for name, agent in named.items()}
        oracle, random = references(rules, progress)
    tables = [
        leaderboard.scores(runs, oracle, random, rules.control.num_steps).assign(agent=name, protocol=rules.digest)
        for name, runs in flown.items()
    ]
    table = pd.concat(tables, ignore_index=True)
    return table[["agent", "protocol", *table.columns.drop(["agent", "protocol"])]]


def load_protocol(protocol: Protocol | str) -> Protocol:
    """A protocol: as it is, or by the name of its file in `conf/protocol`.

    Raises:
        ConfigError: it is none, or there is no such file.
    """
    if isinstance(protocol, str):
        return Protocol.load("protocol", protocol)
    if not isinstance(protocol, Protocol):
        raise ConfigError(
            f"protocol = {format_value(protocol)} is not allowed; give the name of a file in conf/protocol."
        )
    return protocol


class _Choice(Settings):
    """The part of a configuration with the agent."""

    agent: AnyAgent


def configured(name: str, protocol: Protocol) -> Controller:
    """The agent of a file of `conf/agent`, ready to fly under a protocol.

    Raises:
        ConfigError: it needs a model.
    """
    chosen = _Choice.checked({"agent": read("agent", name)}, f"conf/agent/{name}.yaml").agent
    if isinstance(chosen, AgentSettings) or is_learned(chosen):
        raise ConfigError(f"agent = {name!r} needs a model; name an experiment, such as exp5.")
    return protocol.oracle(as_seen=chosen.kind == "seen") if isinstance(chosen, OracleSettings) else chosen


def references(protocol: Protocol, progress: bool = True) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Runs of the oracle and of the agent that acts at random; flown, unless published ones are of this protocol.

    Raises:
        ConfigError: published ones are damaged.
    """
    show = reported if progress else silent
    oracle, random = _published(leaderboard.ORACLE, protocol), _published(leaderboard.RANDOM, protocol)
    return (
        protocol.fly(protocol.oracle(), show) if oracle is None else oracle,
        protocol.fly(protocol.random, show) if random is None else random,
    )


def _published(name: str, protocol: Protocol) -> pd.DataFrame | None:
    """Published runs of an agent; None if there are none of this protocol."""
    folder = reference() / SCORES / name
    if not folder.is_dir():
        return None
    record, runs = leaderboard.read(folder)
    return runs if record["protocol"]["digest"] == protocol.digest else None
