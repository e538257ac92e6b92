"""The claims of Experiment IX, through the fog. They are not the paper's, whose agents go around fog."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from affmap.results import belief, claims, statistics
from affmap.results.claims import Claim, Criterion
from affmap.results.files import Floats
from affmap.results.metrics import METRICS
from affmap.results.numbers import number
from affmap.results.setting import LAYOUT, Setting, make_factor
from affmap.results.statistics import Outcome
from affmap.results.tables import Results

MODEL = make_factor("model.transition")
"""The transition model, a file of `conf/model/transition`."""

PAPER, RECURRENT = "mlp", ("gru", "gatel0rd")
"""Models."""

LIT, DARK = "fog_belt", "fog_belt_dark"
"""Layouts: with views in fog, and without."""

ARRIVES, NEVER = 0.9, 0.1
"""Shares of runs that reach the goal."""

STEPS, NEAR = 15, 0.1
"""Steps into fog, and distance of the belief from the truth (u)."""

NATS = 0.1
"""A difference of losses that would not matter, nats."""

CLEAR = ("free", "touching")
"""Kinds of steps that neither begin nor end in fog."""


@dataclass(frozen=True)
class Models:
    """Scores of models, by member; empty where a model was not flown in a layout."""

    results: Results

    def setting(self, model: str, layout: str) -> Setting | None:
        """The setting of a model in a layout."""
        return next(iter(self.results.where({MODEL.key: model, LAYOUT.key: layout})), None)

    def reached(self, model: str, layout: str) -> Floats:
        """Share of the runs of each member that reach the goal, `[M]`."""
        return claims.member_scores(self.results, "reached", MODEL, model, layout).to_numpy()

    def errors(self, model: str, layout: str) -> Floats:
        """Error of each member's belief `STEPS` steps into fog, `[M]` in u; NaN if it never was so long."""
        setting = self.setting(model, layout)
        return belief.error_after(self.results.trajectories(setting), STEPS) if setting else np.empty(0)

    def losses(self, model: str, layout: str) -> Floats:
        """Mean validation loss of each member over steps outside fog, `[M]` in nats."""
        table = self.results.steps
        if self.setting(model, layout) is None or MODEL.column not in table:
            return np.empty(0)
        own = table[(table[MODEL.column] == model) & (table["world"] == layout) & table["kind"].isin(CLEAR)]
        own = own[own["epoch"] == own["epoch"].max()]
        sums = (own["mean"] * own["steps"]).groupby(own["member"]).sum()
        return (sums / own.groupby("member")["steps"].sum()).to_numpy(float)


Score = Callable[[Models, str, str], Floats]
"""A score `[M]` of a model in a layout, a method of `Models`."""


def _levels(
    results: Results,
    score: Score,
    test: Callable[[Floats], Outcome],
    effect_of: str,
    unit: str,
    models: Sequence[str],
    layout: str,
    says: str,
) -> list[Criterion]:
    """Test the level of the scores of models in a layout; a model that never has one of a member is not tested."""
    criteria = []
    for model in models:
        name, scores = results.name(model), score(Models(results), model, layout)
        outcome = claims.with_note(test(scores), [] if len(scores) else [f"needs runs of {name} in {layout}"])
        criteria.append(Criterion(name if len(models) > 1 else "", effect_of, unit, outcome, f"{name}: {says}"))
    return criteria


def _compared(
    results: Results,
    score: Score,
    test: Callable[[Floats, Floats], Outcome],
    unit: str,
    layouts: Sequence[str],
    says: str,
) -> list[Criterion]:
    """Test the scores of each recurrent model beside those of the paper's."""
    criteria, models = [], Models(results)
    for layout in layouts:
        for model in RECURRENT:
            one, other = score(models, model, layout), score(models, PAPER, layout)
            name, than = results.name(model), results.name(PAPER)
            if len(one) == len(other) > 0:
                outcome = claims.with_note(test(one, other), [f"{number(one.mean())} against {number(other.mean())}"])
            else:
                outcome = statistics.undecided(claims.SIGNED_RANK, 0, f"needs runs of {name} and {than} in {layout}")
            part = name if len(layouts) == 1 else f"{name}, {results.name(layout)}"
            criteria.append(Criterion(part, f"{name} minus {than}", unit, outcome, f"{part}: {says}"))
    return criteria


_arrives = partial(
    _levels,
    score=Models.reached,
    test=partial(statistics.at_least, level=ARRIVES),
    effect_of="share",
    unit=METRICS["reached"].unit,
    models=RECURRENT,
    says=f"at least {ARRIVES:g} of the runs reach the goal.",
)

_near = partial(
    _levels,
    score=Models.errors,
    test=partial(statistics.below, level=NEAR),
    effect_of=f"error of the belief {STEPS} steps into fog",
    unit="u",
    models=RECURRENT,
    says=f"the belief is less than {NEAR:g} u from the truth.",
)

CLAIMS = (
    Claim(
        "IX-1",
        f"With a hidden state, at least {ARRIVES:g} of the runs reach the goal through the fog.",
        partial(_arrives, layout=LIT),
    ),
    Claim(
        "IX-2",
        f"Without one (MLP), fewer than {NEVER:g} of them do.",
        partial(
            _levels,
            score=Models.reached,
            test=partial(statistics.below, level=NEVER),
            effect_of="share",
            unit=METRICS["reached"].unit,
            models=(PAPER,),
            layout=LIT,
            says=f"fewer than {NEVER:g} of the runs reach the goal.",
        ),
    ),
    Claim(
        "IX-3",
        f"With a hidden state, the believed position {STEPS} steps into fog is within {NEAR:g} u (root mean square) of "
        "the true one.",
        partial(_near, layout=LIT),
    ),
    Claim(
        "IX-4",
        f"Outside fog, a hidden state costs nothing: the loss is at most {NATS:g} nats higher than the MLP's.",
        partial(
            _compared,
            score=Models.losses,
            test=lambda one, other: statistics.below(one - other, NATS),
            unit="nats",
            layouts=(LIT,),
            says=f"the loss is at most {NATS:g} nats higher.",
        ),
    ),
    Claim(
        "IX-5",
        f"If nothing is seen in fog, still at least {ARRIVES:g} of the runs reach the goal with a hidden state.",
        partial(_arrives, layout=DARK),
    ),
    Claim(
        "IX-6",
        f"If nothing is seen in fog, the belief {STEPS} steps into it is as near to the truth: within {NEAR:g} u.",
        partial(_near, layout=DARK),
    ),
    Claim(
        "IX-7",
        "A hidden state brings the belief nearer to the truth than the MLP's, with views in fog and without.",
        partial(
            _compared,
            score=Models.errors,
            test=lambda one, other: statistics.paired(one, other, "lower"),
            unit="u",
            layouts=(LIT, DARK),
            says=f"the error {STEPS} steps into fog is lower.",
        ),
    ),
    Claim(
        "IX-8",
        "A hidden state brings more runs to the goal than the MLP, with views in fog and without.",
        partial(
            _compared,
            score=Models.reached,
            test=lambda one, other: statistics.paired(one, other, "higher"),
            unit=METRICS["reached"].unit,
            layouts=(LIT, DARK),
            says="more runs reach the goal.",
        ),
    ),
)
