"""Scores of agents under an evaluation protocol, on the scale from chance to the true physics; a folder for each agent.

The gain of a run is the share of its steps that are left when it reaches the goal, and 0 if it never does or has been
in fog: to arrive is better than not to, and to arrive early better than late. The score of an agent in a world is the
mean gain of its runs, on the scale on which the agent that acts at random has 0 and the oracle has 1. So an agent that
is faster than the oracle has more than 1.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from affmap.results import manifest
from affmap.results.files import RUNS
from affmap.results.metrics import stored_metrics
from affmap.results.statistics import interval
from affmap.settings import ConfigError
from affmap.store.files import digests, guarded_read, replace_folder

MEAN = "mean"
"""Entry of the column `world` for all worlds together."""

ORACLE, RANDOM = "oracle", "random"
"""Folders of the agents whose scores are 1 and 0."""


def scores(runs: pd.DataFrame, oracle: pd.DataFrame, random: pd.DataFrame, num_steps: int) -> pd.DataFrame:
    """Score the runs of an agent.

    Args:
        runs: of the agent, a row each: `world`, `run`, and metrics of runs, of which `success`, `steps_to_reach` and
            `mean_distance` count.
        oracle: the same runs of the oracle, in all worlds, in the order of the table.
        random: those of the agent that acts at random.
        num_steps: T, length of the runs.

    Returns:
        A row for each world, and one for all, `mean`, with the columns `world`; `success` and `mean_distance` (u),
        means over runs; `score`; `low` and `high`, the ends of its 95 % bootstrap interval over runs, in which the
        values of oracle and random are constants. Empty are worlds that the agent has not flown in, and scores where
        the oracle is no better than chance; the mean is over all other worlds, and empty unless the agent has flown in
        all of them.
    """
    worlds = list(dict.fromkeys(oracle["world"]))
    own, best, chance = (_gains(each, num_steps).reindex(columns=worlds) for each in (runs, oracle, random))
    scale = (best.mean() - chance.mean()).where(lambda each: each > 0)
    table = runs.groupby("world")[["success", "mean_distance"]].mean().astype(float).reindex(worlds)
    table["score"] = (own.mean() - chance.mean()) / scale
    scaled = (own - chance.mean()) / scale  # of each run
    telling = scale.index[scale.notna()]
    table.loc[MEAN] = table.mean(skipna=False)
    table.loc[MEAN, "score"] = table.loc[telling, "score"].mean(skipna=False)
    scaled[MEAN] = scaled[telling].mean(axis=1, skipna=False)
    table[["low", "high"]] = [_interval(scaled[world].to_numpy()) for world in table.index]
    return table.rename_axis("world").reset_index()


def _gains(runs: pd.DataFrame, num_steps: int) -> pd.DataFrame:
    """The gain of each run: a row for each number of a run, a column for each world."""
    left = 1 - runs["steps_to_reach"].astype(float) / num_steps
    gains = left.where(runs["success"].astype(bool), 0.0)
    return runs.assign(gain=gains).pivot(index="run", columns="world", values="gain")


def _interval(values: np.ndarray) -> tuple[float, float]:
    return (np.nan, np.nan) if np.isnan(values).any() else interval(values)


def write(folder: Path, runs: pd.DataFrame, record: Mapping[str, Any], sources: Sequence[Path] = ()) -> None:
    """Write the runs of an agent, in place of earlier ones.

    Args:
        folder: of the agent.
        runs: as for `scores`; random numbers decide their starts and goals, which are not written.
        record: of their origin, with the entry `protocol`, which has its `name` and its `digest`.
        sources: files of the agent, which are kept beside the runs.
    """
    new = folder.with_name(f".{folder.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    columns = ["world", "member", "run", *stored_metrics()]
    runs[columns].to_csv(new / RUNS, index=False, float_format="%.6g", lineterminator="\n")
    for path in sources:
        shutil.copy(path, new)
    manifest.save(new, record, digests(new))
    replace_folder(new, folder)


def check_folder(folder: Path) -> None:
    """Make sure that the runs of an agent can be written into a folder.

    Raises:
        ConfigError: it cannot be made, or holds something else.
    """
    manifest.check_place(folder)
    if folder.exists() and any(folder.iterdir()) and (problems := _problems(folder)):
        raise ConfigError(f"{folder} cannot hold the runs of an agent: {problems[0]} Name another folder.")


def read(folder: Path) -> tuple[dict[str, Any], pd.DataFrame]:
    """The record of the runs of an agent, and the runs as `scores` takes them.

    Raises:
        ConfigError: they are not there, or not as they were written.
    """
    if problems := _problems(folder):
        raise ConfigError(f"{problems[0]} Restore it, or let affmap-score write it anew.")
    with guarded_read(folder / RUNS):
        return manifest.read(folder), pd.read_csv(folder / RUNS, dtype={"steps_to_reach": "Int64"})


def _problems(folder: Path) -> list[str]:
    """Errors in the files of an agent's runs, a sentence each."""
    if problems := manifest.problems(folder, others=False):
        return problems
    is_ours = "protocol" in manifest.read(folder) and (folder / RUNS).is_file()
    return [] if is_ours else [f"{folder} holds other results."]
