"""The table of all agents that were scored under the evaluation protocol, from their published runs."""

from functools import cache
from typing import Any

import pandas as pd
from places import REFERENCE, ROOT

from affmap.control.protocol import Protocol
from affmap.control.scoring import SCORES
from affmap.report.markdown import code, escape, table, text_table
from affmap.results import leaderboard
from affmap.results.numbers import estimate, number


def scores(what: str = "score") -> str:
    """A table of all agents, best first: `score`, `success` or `mean_distance` in each world; or their `origin`."""
    if what == "origin":
        return _origins()
    heads = ["agent", leaderboard.MEAN, *(world.name for world in _protocol().worlds)]
    return text_table(heads, [[record["agent"], *_cells(own.set_index("world"), what)] for record, own in _rows()])


def protocol(name: str) -> str:
    """The file of a protocol and its digest."""
    text = (ROOT / f"conf/protocol/{name}.yaml").read_text("utf-8").strip()
    digest = Protocol.load("protocol", name).digest
    return f"```yaml\n{text}\n```\n\nDigest: `{digest}`"


def _cells(own: pd.DataFrame, what: str) -> list[str]:
    """Values of an agent: their mean, and that of each world."""
    mean = own.loc[leaderboard.MEAN]
    first = estimate(mean["score"], mean["low"], mean["high"]) if what == "score" else number(mean[what])
    return [first, *(number(value) for value in own[what].drop(leaderboard.MEAN))]


def _origins() -> str:
    """Of each agent its members, how long it flew, and the command that scores it."""
    rows = [
        (escape(each["agent"]), str(each["members"]), f"{each['seconds'] / 60:.1f}", code(each["command"]))
        for each, _ in _rows()
    ]
    return table(["agent", "members", "minutes", "command"], rows)


@cache
def _rows() -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Record and scores of each agent, best first; those that cannot see all worlds are last.

    Raises:
        ValueError: one was scored under another protocol.
    """
    read = {folder.name: leaderboard.read(folder) for folder in sorted((REFERENCE / SCORES).iterdir())}
    rules = _protocol()
    for name, (record, _) in read.items():
        if record["protocol"]["digest"] != rules.digest:
            raise ValueError(f"{SCORES}/{name} was scored under another protocol than {rules.digest}.")
    ends = read[leaderboard.ORACLE][1], read[leaderboard.RANDOM][1]
    rows = [(record, leaderboard.scores(runs, *ends, rules.control.num_steps)) for record, runs in read.values()]
    return sorted(rows, key=lambda row: _order(row[1]))


def _order(own: pd.DataFrame) -> tuple[int, float]:
    """Smaller for a better agent: by its mean if it has one, else by that of the worlds that it has flown in."""
    *worlds, mean = own["score"]
    seen = pd.Series(worlds).mean()
    return (0, -mean) if pd.notna(mean) else (1, -seen)


@cache
def _protocol() -> Protocol:
    return Protocol.load("protocol", "eight_worlds")
