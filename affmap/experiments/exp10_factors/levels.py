"""Success by factor and level: each member's share of successful runs under each variation."""

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from affmap.control.variation import FACTORS, HOME, Variation
from affmap.results import claims
from affmap.results.setting import make_factor
from affmap.results.tables import Results, score_matrix

VARIATION = make_factor("variation")
"""Factor and level, such as `mass/0.2`."""

AGENT, BLIND = 8, 0
"""Context sizes of the agent and of one without affordances."""


def levels(results: Results) -> Mapping[str, Sequence[Variation]]:
    """Factor -> its levels but home, ascending, in the order of the experiment."""
    read = [Variation.checked(Variation.read(text), "variation") for text in _texts(results) if text != HOME]
    names = dict.fromkeys(each.factor for each in read)
    return {name: sorted((each for each in read if each.factor == name), key=lambda each: each.value) for name in names}


def successes(results: Results, agent: int | str) -> pd.DataFrame:
    """Share of successful runs of each member (rows) under each variation (columns); NaN where runs are missing.

    Args:
        results: of the experiment.
        agent: the context size of one with a model, or the kind of one without.

    Returns:
        The table, which is empty if the agent did not fly.
    """
    if isinstance(agent, int):
        runs = claims.select_runs(results)
        runs = runs[runs["context_size"] == agent]
    else:
        runs = results.baseline_runs
        runs = runs[runs["planner"] == agent]
    if VARIATION.column not in runs or runs.empty:
        return pd.DataFrame()
    return score_matrix(runs, "success", [VARIATION.column]).reindex(columns=_texts(results))


def left(shares: pd.DataFrame, level: Variation, reference: "pd.Series[float]") -> float:
    """Success at a level as a share of a reference's `[M]`, all members together; NaN of a reference without any."""
    success, whole = float(shares[str(level)].mean()), float(reference.mean())
    return success / whole if whole else math.nan


def _texts(results: Results) -> list[str]:
    """The variations of the settings, home among them, as on the command line."""
    return list(dict.fromkeys(str(setting.values.get(VARIATION.key, HOME)) for setting in results.settings))


def value_name(variation: Variation) -> str:
    """A level for readers: its value and unit."""
    return f"{variation.value:g} {FACTORS[variation.factor].unit}".strip()
