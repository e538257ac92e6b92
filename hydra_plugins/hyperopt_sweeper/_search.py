"""Ask and tell with hyperopt, trial by trial. The only module that imports hyperopt.

Each trial has a seed of its own, derived from the search's seed and the trial's number, so that a resumed search asks
for the same points as an undisturbed one. The trials of a batch are asked for one after the other, while those before
have no result, which hyperopt takes for the worst; so they keep apart from each other.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from hyperopt import STATUS_FAIL, STATUS_OK, Domain, Trials, anneal, hp, rand, tpe
from hyperopt.base import JOB_STATE_DONE
from hyperopt.fmin import generate_trial

from hydra_plugins.hyperopt_sweeper._space import Dimension, Interval, Point, Space


class Search:
    """A search of one space; it always minimizes."""

    def __init__(
        self,
        space: Space,
        algorithm: Literal["tpe", "random", "anneal"],
        *,
        num_startup: int,
        seed: int,
        initial: Sequence[Point],
    ) -> None:
        """Begin a search without trials.

        Args:
            space: to be searched.
            algorithm: hyperopt's: tree of Parzen estimators, random search or annealing.
            num_startup: trials that tpe draws at random before it models anything, `initial` among them.
            seed: of all randomness.
            initial: points of the first trials.
        """
        algorithms: dict[str, Callable[..., Any]] = {
            "tpe": partial(tpe.suggest, n_startup_jobs=num_startup, verbose=False),
            "random": rand.suggest,
            "anneal": anneal.suggest,
        }
        self._suggest = algorithms[algorithm]
        self._domain = Domain(None, {key: _node(key, dimension) for key, dimension in space.dimensions.items()})
        self._seed = seed
        self._initial = initial
        self._trials = Trials()

    def ask(self) -> Point:
        """The point of the next trial."""
        number = len(self._trials)
        point = self._initial[number] if number < len(self._initial) else self._suggest_point(number)
        self._insert(point)
        return point

    def tell(self, number: int, loss: float | None) -> None:
        """Report the loss of a trial; None if it failed."""
        doc = self._trials.trials[number]
        doc["state"] = JOB_STATE_DONE
        doc["result"] = {"status": STATUS_FAIL} if loss is None else {"status": STATUS_OK, "loss": loss}

    def restore(self, point: Point, loss: float | None) -> None:
        """Add the next trial of an earlier start, with its result."""
        self._insert(point)
        self.tell(len(self._trials) - 1, loss)

    def _suggest_point(self, number: int) -> Point:
        (doc,) = self._suggest(
            self._trials.new_trial_ids(1), self._domain, self._trials, trial_seed(self._seed, number)
        )
        # As plain numbers, as they are after a restart.
        return {key: np.asarray(value).item() for key, (value,) in doc["misc"]["vals"].items()}

    def _insert(self, point: Point) -> None:
        self._trials.insert_trial_docs([generate_trial(len(self._trials), dict(point))])
        self._trials.refresh()


def trial_seed(seed: int, number: int) -> int:
    """The seed that hyperopt gets for a trial."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def _node(key: str, dimension: Dimension) -> Any:
    """Hyperopt's node of a dimension; integers are rounded from half a step beyond both ends, so that none is rarer."""
    if not isinstance(dimension, Interval):
        count = len(dimension.values)
        return hp.quniform(key, -0.5, count - 0.5, 1) if dimension.ordered else hp.choice(key, list(range(count)))
    margin = 0.5 if dimension.integer else 0.0
    low, high = dimension.low - margin, dimension.high + margin
    if dimension.log:
        low, high = np.log([low, high]).tolist()
    kinds = {
        (False, False): hp.uniform,
        (False, True): hp.loguniform,
        (True, False): partial(hp.quniform, q=1),
        (True, True): partial(hp.qloguniform, q=1),
    }
    return kinds[dimension.integer, dimension.log](key, low, high)
