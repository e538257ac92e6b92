"""The claims of Experiment X, twelve factors of variation.

An agent keeps its success under a factor if it does at every level of the factor's range: there its share of
successful runs is at least `KEPT` of that at home, by the 95 % interval over members of the difference.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from affmap.control.variation import FACTORS, HOME, Variation
from affmap.experiments.exp10_factors.levels import AGENT, BLIND, left, levels, successes, value_name
from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.statistics import Outcome, Verdict
from affmap.results.tables import Results

KEPT = 0.9
"""Share of success that is to be left."""

NUM_FACTORS, ENOUGH = 12, 10
"""Factors of the experiment, and those under which success is to be kept."""

UNIT = METRICS["success"].unit

Reference = Callable[[Variation], pd.Series]
"""The success `[M]` that a level's is compared with."""


def at_home(shares: pd.DataFrame) -> Reference:
    """The same agent's success at home."""
    return lambda level: shares[HOME]


def at_level(shares: pd.DataFrame) -> Reference:
    """Another agent's success at the same level."""
    return lambda level: shares[str(level)]


def keeps_at(shares: pd.DataFrame, level: Variation, reference: Reference) -> Outcome:
    """Test that success is kept at a level; the effect is success minus `KEPT` of the reference."""
    return statistics.at_least((shares[str(level)] - KEPT * reference(level)).to_numpy(float), 0.0)


def keeps(shares: pd.DataFrame, factor: str, every: Sequence[Variation], reference: Reference) -> Criterion:
    """Test that success is kept at every level of a factor; the effect is that of the worst level."""
    outcomes = [keeps_at(shares, level, reference) for level in every]
    effects = [outcome.effect if outcome.effect is not None else np.inf for outcome in outcomes]
    worst = int(np.argmin(effects))
    each = [f"{number(left(shares, level, reference(level)))} at {value_name(level)}" for level in every]
    outcome = claims.with_note(statistics.everywhere(outcomes, outcomes[worst]), [f"left: {', '.join(each)}"])
    effect_of = f"success minus {KEPT:g} of the reference, at {value_name(every[worst])}"
    label = FACTORS[factor].label
    says = f"{label}: at least {KEPT:g} of the success is left at every level."
    return Criterion(label, effect_of, UNIT, outcome, says)


def _by_factor(results: Results, shares: pd.DataFrame, reference: pd.DataFrame, own: bool) -> list[Criterion]:
    """A part for each factor; a single one that is not tested, if an agent has not flown."""
    every = levels(results)
    if not every or shares.empty or reference.empty or (own and HOME not in shares):
        missing = statistics.undecided(f"95 % interval from {KEPT:g} up", 0, "needs runs of both agents, and at home")
        return [Criterion("", "", UNIT, missing)]
    baseline = at_home(reference) if own else at_level(reference)
    return [keeps(shares, factor, of_factor, baseline) for factor, of_factor in every.items()]


def _enough(parts: Sequence[Criterion]) -> list[Criterion]:
    """Test that enough factors hold; the factors themselves are shown, and do not count."""
    verdicts = [part.outcome.verdict for part in parts]
    held, failed = verdicts.count(Verdict.HOLDS), verdicts.count(Verdict.DOES_NOT_HOLD)
    test, members = f"at least {ENOUGH} of {NUM_FACTORS} factors hold", max(part.outcome.members for part in parts)
    if len(parts) < NUM_FACTORS:
        outcome = statistics.undecided(test, members, f"needs runs of {NUM_FACTORS} factors")
    else:
        decided = Verdict.DOES_NOT_HOLD if failed > NUM_FACTORS - ENOUGH else Verdict.NOT_DECIDED
        outcome = Outcome(test, members, Verdict.HOLDS if held >= ENOUGH else decided, float(held))
        outcome = claims.with_note(outcome, [f"do not hold: {failed}, not decided: {len(parts) - held - failed}"])
    says = f"At least {KEPT:g} of the success is left under {ENOUGH} of {NUM_FACTORS} factors."
    return [Criterion("all", "factors that hold", "factors", outcome, says), *(p._replace(counts=False) for p in parts)]


def _agent_keeps(results: Results) -> list[Criterion]:
    shares = successes(results, AGENT)
    return _enough(_by_factor(results, shares, shares, own=True))


def _oracle_keeps(results: Results) -> list[Criterion]:
    shares = successes(results, "oracle")
    return _by_factor(results, shares, shares, own=True)


def _like_the_oracle(results: Results) -> list[Criterion]:
    return _enough(_by_factor(results, successes(results, AGENT), successes(results, "oracle"), own=False))


def _codes_help(results: Results) -> list[Criterion]:
    """Test each factor's mean over levels, of the agent and of the one without codes."""
    criteria = []
    agents = [successes(results, size) for size in (AGENT, BLIND)]
    for factor, every in levels(results).items():
        label, texts = FACTORS[factor].label, [str(level) for level in every]
        if any(shares.empty for shares in agents):
            outcome = statistics.undecided(claims.SIGNED_RANK, 0, "needs runs with codes and without")
        else:
            with_codes, without = (shares[texts].mean(axis=1).to_numpy(float) for shares in agents)
            outcome = statistics.paired(with_codes, without, "higher")
            note = f"{number(with_codes.mean())} against {number(without.mean())}"
            outcome = claims.with_note(outcome, [note])
        says = f"{label}: more runs succeed with codes, on average over its levels."
        criteria.append(Criterion(label, f"C = {AGENT} minus C = {BLIND}", UNIT, outcome, says))
    return criteria or [Criterion("", "", UNIT, statistics.undecided(claims.SIGNED_RANK, 0, "needs a variation"))]


CLAIMS = (
    Claim(
        "X-1",
        f"The affordance agent (C = {AGENT}) keeps at least {KEPT:g} of its success at home at every level of at least "
        f"{ENOUGH} of the {NUM_FACTORS} factors.",
        _agent_keeps,
    ),
    Claim(
        "X-2",
        f"The worlds are not to blame: an oracle that knows the varied physics keeps at least {KEPT:g} of its success "
        "at every level of each factor.",
        _oracle_keeps,
    ),
    Claim(
        "X-3",
        f"At every level of at least {ENOUGH} of the {NUM_FACTORS} factors the agent has at least {KEPT:g} of the "
        "oracle's success at the same level.",
        _like_the_oracle,
    ),
    Claim(
        "X-4",
        "Affordances help away from home, too: averaged over the levels of a factor, more runs succeed with codes than "
        "without, under each factor.",
        _codes_help,
    ),
)
