"""The claims of Experiment X, rivals: differences of mean distances, paired by member."""

from collections.abc import Sequence
from functools import partial

from affmap.experiments.exp10.pairs import AGENT, HOME, UNSEEN, at_most, compared, lower
from affmap.results.claims import Claim, Criterion, Test
from affmap.results.tables import Results

DISTILLED, CLONING, OFFLINE, PPO, SAC, LONG = "distilled", "cloning", "td3_bc", "ppo", "sac", "ppo_million"
"""Rivals, by their names in the column of planners."""

METRIC = "mean_distance"

LENGTH = 0.03
"""Difference of a mean distance that would not matter, u."""

_AT_MOST = f"the mean distance is at most {LENGTH:g} u longer."
_LOWER = "the mean distance is shorter."


def _claim(
    results: Results, pairs: Sequence[tuple[str, str]], layouts: Sequence[str], test: Test, says: str
) -> list[Criterion]:
    return [compared(results, *pair, layout, METRIC, test, says) for pair in pairs for layout in layouts]


def _all(pairs: Sequence[tuple[str, str]], layouts: Sequence[str], test: Test, says: str) -> "partial[list[Criterion]]":
    """The test of each pair in each layout."""
    return partial(_claim, pairs=pairs, layouts=layouts, test=test, says=says)


CLAIMS = (
    Claim(
        "X-5",
        "A policy of a thousand parameters that imitates the agent's plans flies as well where it was trained: its "
        f"mean distance is at most {LENGTH:g} u longer.",
        _all([(DISTILLED, AGENT)], [HOME], at_most(LENGTH), _AT_MOST),
    ),
    Claim(
        "X-6",
        "It does so in two worlds that neither has seen, too.",
        _all([(DISTILLED, AGENT)], UNSEEN, at_most(LENGTH), _AT_MOST),
    ),
    Claim(
        "X-7",
        "With as many steps of experience, 60,000, the agent flies better at home than PPO and than behaviour cloning.",
        _all([(AGENT, PPO), (AGENT, CLONING)], [HOME], lower, _LOWER),
    ),
    Claim(
        "X-8",
        f"With a million steps, PPO does not fly better at home than the agent with 60,000, by more than {LENGTH:g} u.",
        _all([(AGENT, LONG)], [HOME], at_most(LENGTH), _AT_MOST),
    ),
    Claim(
        "X-9",
        "In two worlds that neither has seen the agent flies better than PPO with a million steps.",
        _all([(AGENT, LONG)], UNSEEN, lower, _LOWER),
    ),
    Claim(
        "X-10",
        "With as many steps of experience, 60,000, the agent flies better at home than SAC.",
        _all([(AGENT, SAC)], [HOME], lower, _LOWER),
    ),
    Claim(
        "X-11",
        "From the same steps of random exploration, the agent flies better at home than TD3+BC.",
        _all([(AGENT, OFFLINE)], [HOME], lower, _LOWER),
    ),
    Claim(
        "X-12",
        "In two worlds that neither has seen the agent flies better than SAC.",
        _all([(AGENT, SAC)], UNSEEN, lower, _LOWER),
    ),
    Claim(
        "X-13",
        "In two worlds that neither has seen the agent flies better than TD3+BC.",
        _all([(AGENT, OFFLINE)], UNSEEN, lower, _LOWER),
    ),
    Claim(
        "X-14",
        "From the same steps of random exploration, TD3+BC flies better at home than behaviour cloning.",
        _all([(OFFLINE, CLONING)], [HOME], lower, _LOWER),
    ),
    Claim(
        "X-15",
        "With as many steps of experience, 60,000, SAC flies better at home than PPO.",
        _all([(SAC, PPO)], [HOME], lower, _LOWER),
    ),
)
