"""The claims of Experiment IX, a memorised map: the paper leaves it to future work."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from affmap.results import claims, statistics
from affmap.results.claims import Claim, Criterion, Test
from affmap.results.files import Floats, Recall
from affmap.results.metrics import METRICS
from affmap.results.setting import LAYOUT, make_factor
from affmap.results.statistics import Outcome
from affmap.results.tables import Results

MEMORY = make_factor("memory")
"""The memory, a file of `conf/memory`."""

VIEWS, EXPLORED, OUTDATED, REPAIRED, EMPTY = "none", "explored", "outdated", "repaired", "empty"
"""Memories; `VIEWS` is the paper's agent."""

WORLDS, MOVED = ("original", "two_obstacles", "twelve_obstacles", "one_moved"), "one_moved"
"""Layouts: all, and that in which an obstacle is elsewhere than in the original."""

LENGTH = 0.05
"""Difference of a mean distance that would not matter, u."""

STEPS = 50
"""Steps in which a map is to be repaired: `early_steps` of `conf/memory/repaired.yaml`."""

LEFT = 0.5
"""Share of the error of an outdated map that may be left then."""

ARRIVES = 0.9
"""Share of runs that reach the goal."""


@dataclass(frozen=True)
class Memories:
    """Scores of memories, by member; empty where one did not fly in a layout."""

    results: Results

    def scores(self, memory: str, layout: str, metric: str) -> Floats:
        """Mean of a metric over the runs of each member, `[M]`."""
        return claims.member_scores(self.results, metric, MEMORY, memory, layout).to_numpy()

    def recall(self, memory: str, layout: str) -> Recall | None:
        """The memorised maps of a memory in a layout."""
        setting = next(iter(self.results.where({MEMORY.key: memory, LAYOUT.key: layout})), None)
        return self.results.recall(setting) if setting else None

    def left(self, memory: str, layout: str) -> Floats:
        """Share of the first error of each member's map that is left after the earlier flight, `[M]`."""
        recall = self.recall(memory, layout)
        if recall is None:
            return np.empty(0)
        errors = np.array([recall.error[recall.member == member].mean(0) for member in np.unique(recall.member)])
        return np.asarray(errors[:, recall.earlier] / errors[:, 0])


def _compared(
    results: Results, first: str, second: str, layouts: Sequence[str], test: Test, says: str
) -> list[Criterion]:
    """Test the mean distances of two memories in layouts."""
    criteria, memories, metric = [], Memories(results), METRICS["mean_distance"]
    names = [results.name(memory) for memory in (first, second)]
    for layout in layouts:
        one, other = (memories.scores(memory, layout, "mean_distance") for memory in (first, second))
        label = results.name(layout)
        if len(one) == len(other) > 0:
            outcome = test(one, other)
        else:
            outcome = statistics.undecided(
                claims.SIGNED_RANK, 0, f"needs runs with {' and with '.join(names)} in {label}"
            )
        part = label if len(layouts) > 1 else ""
        criteria.append(Criterion(part, " minus ".join(names), metric.unit, outcome, f"{label}: {says}"))
    return criteria


def _levels(
    results: Results,
    memory: str,
    layouts: Sequence[str],
    score: Callable[[Memories, str, str], Floats],
    test: Callable[[Floats], Outcome],
    effect_of: str,
    says: str,
) -> list[Criterion]:
    """Test the level of the scores of a memory in layouts."""
    criteria = []
    for layout in layouts:
        label, scores = results.name(layout), score(Memories(results), memory, layout)
        needs = [] if len(scores) else [f"needs runs with {results.name(memory)} in {label}"]
        outcome = claims.with_note(test(scores), needs)
        criteria.append(Criterion(label if len(layouts) > 1 else "", effect_of, "share", outcome, f"{label}: {says}"))
    return criteria


def _not_longer(one: Floats, other: Floats) -> Outcome:
    return statistics.below(one - other, LENGTH)


CLAIMS = (
    Claim(
        "IX-9",
        "A memorised map replaces views in worlds that the agent has explored: its mean distance is at most "
        f"{LENGTH:g} u longer.",
        partial(
            _compared,
            first=EXPLORED,
            second=VIEWS,
            layouts=WORLDS,
            test=_not_longer,
            says=f"the mean distance is at most {LENGTH:g} u longer.",
        ),
    ),
    Claim(
        "IX-10",
        "After an obstacle has moved, a map that stays as it was is worse than views.",
        partial(
            _compared,
            first=OUTDATED,
            second=VIEWS,
            layouts=(MOVED,),
            test=partial(statistics.paired, order="higher"),
            says="the mean distance is longer.",
        ),
    ),
    Claim(
        "IX-11",
        f"After {STEPS} steps of flight it is repaired: the mean distance is at most {LENGTH:g} u longer than with "
        "views.",
        partial(
            _compared,
            first=REPAIRED,
            second=VIEWS,
            layouts=(MOVED,),
            test=_not_longer,
            says=f"the mean distance is at most {LENGTH:g} u longer.",
        ),
    ),
    Claim(
        "IX-12",
        "The repaired map is better than the outdated one.",
        partial(
            _compared,
            first=REPAIRED,
            second=OUTDATED,
            layouts=(MOVED,),
            test=partial(statistics.paired, order="lower"),
            says="the mean distance is shorter.",
        ),
    ),
    Claim(
        "IX-13",
        f"After {STEPS} steps less than {LEFT:g} of the error of the codes is left where they have changed.",
        partial(
            _levels,
            memory=REPAIRED,
            layouts=(MOVED,),
            score=Memories.left,
            test=partial(statistics.below, level=LEFT),
            effect_of="error that is left",
            says=f"less than {LEFT:g} of the error is left.",
        ),
    ),
    Claim(
        "IX-14",
        f"An agent that has never been in a world, and remembers nothing, reaches the goal in at least {ARRIVES:g} of "
        "the runs.",
        partial(
            _levels,
            memory=EMPTY,
            layouts=WORLDS,
            score=partial(Memories.scores, metric="reached"),
            test=partial(statistics.at_least, level=ARRIVES),
            effect_of="share",
            says=f"at least {ARRIVES:g} of the runs reach the goal.",
        ),
    ),
)
