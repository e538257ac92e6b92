import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import pytest
from hyperopt import STATUS_FAIL, STATUS_OK, Domain, Trials, anneal, fmin, hp, rand, tpe
from hyperopt.base import JOB_STATE_DONE
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from hydra_plugins.hyperopt_sweeper._search import Search, trial_seed
from hydra_plugins.hyperopt_sweeper._space import Interval, Options, Point, Space

Algorithm = Literal["tpe", "random", "anneal"]
ALGORITHMS: list[Algorithm] = ["tpe", "random", "anneal"]

SPACE = Space(
    {
        "x": Interval(-5.0, 5.0, log=False, integer=False),
        "rate": Interval(1e-4, 1e-1, log=True, integer=False),
        "z": Options(("a", "b", "c"), ("a", "b", "c"), ordered=False),
    }
)
HYPEROPT = {
    "x": hp.uniform("x", -5.0, 5.0),
    "rate": hp.loguniform("rate", math.log(1e-4), math.log(1e-1)),
    "z": hp.choice("z", [0, 1, 2]),
}
SUGGEST = {
    "tpe": partial(tpe.suggest, n_startup_jobs=8, verbose=False),
    "random": rand.suggest,
    "anneal": anneal.suggest,
}


def new_search(space: Space, algorithm: Algorithm = "random", seed: int = 3, initial: Sequence[Point] = ()) -> Search:
    return Search(space, algorithm, num_startup=8, seed=seed, initial=initial)


def loss_of(point: Point) -> float | None:
    """A loss that some trials do not have."""
    if point["x"] > 3:
        return None
    return (point["x"] - 1) ** 2 + (math.log10(point["rate"]) + 2) ** 2 + point["z"]


def run(search: Search, num: int, loss: Callable[[Point], float | None], batch: int = 1, first: int = 0) -> list[Point]:
    points: list[Point] = []
    while len(points) < num:
        asked = [search.ask() for _ in range(min(batch, num - len(points)))]
        for number, point in enumerate(asked, start=first + len(points)):
            search.tell(number, loss(point))
        points += asked
    return points


class Seeds:
    """In the place of the generator that fmin draws seeds from."""

    def __init__(self, seed: int) -> None:
        self.seed, self.number = seed, -1

    def integers(self, high: int) -> int:
        self.number += 1
        return trial_seed(self.seed, self.number)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_one_at_a_time_is_hyperopts_own_search(algorithm: Algorithm) -> None:
    """Reference: hyperopt's fmin with a space written by hand, which gets the same seeds."""

    def objective(values: dict[str, Any]) -> dict[str, Any]:
        loss = loss_of(values)
        return {"status": STATUS_FAIL} if loss is None else {"status": STATUS_OK, "loss": loss}

    trials = Trials()
    fmin(objective, HYPEROPT, SUGGEST[algorithm], 25, trials=trials, rstate=Seeds(3), verbose=False)
    expected = [{key: value for key, (value,) in misc["vals"].items()} for misc in trials.miscs]
    assert run(new_search(SPACE, algorithm), 25, loss_of) == expected
    assert sum(loss_of(point) is None for point in expected) >= 1


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_batch_is_what_hyperopt_asks_for_while_others_run(algorithm: Algorithm) -> None:
    """Reference: hyperopt's interface used directly, with its own documents as they are."""
    domain, trials, expected = Domain(None, HYPEROPT), Trials(), []
    for _ in range(6):
        for _ in range(4):
            seed = trial_seed(3, len(trials))
            trials.insert_trial_docs(SUGGEST[algorithm](trials.new_trial_ids(1), domain, trials, seed))
            trials.refresh()
        for doc in trials.trials[-4:]:
            point = {key: value for key, (value,) in doc["misc"]["vals"].items()}
            loss = loss_of(point)
            doc["state"] = JOB_STATE_DONE
            doc["result"] = {"status": STATUS_FAIL} if loss is None else {"status": STATUS_OK, "loss": loss}
            expected.append(point)
    assert run(new_search(SPACE, algorithm), 24, loss_of, batch=4) == expected


def test_random_search_does_not_depend_on_batches() -> None:
    """Reference: batches of one."""
    assert run(new_search(SPACE), 10, loss_of, batch=4) == run(new_search(SPACE), 10, loss_of)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_restored_search_goes_on_as_the_undisturbed_one(algorithm: Algorithm) -> None:
    """Reference: the same undisturbed."""
    whole = run(new_search(SPACE, algorithm), 24, loss_of, batch=4)
    assert len({tuple(point.items()) for point in whole}) == 24
    for stopped in (4, 12, 20):
        search = new_search(SPACE, algorithm)
        for point in whole[:stopped]:
            search.restore(point, loss_of(point))
        assert run(search, 24 - stopped, loss_of, batch=4, first=stopped) == whole[stopped:]


def test_initial_points_come_first_and_count() -> None:
    """Reference: the points themselves; then hyperopt's seeds by the number of the trial."""
    initial = [{"x": 1.0, "rate": 0.01, "z": 0}, {"x": 2.0, "rate": 0.1, "z": 2}]
    points = run(new_search(SPACE, initial=initial), 5, loss_of)
    assert points[:2] == initial
    assert points[2:] == run(new_search(SPACE), 5, loss_of)[2:]


def test_seeds_differ() -> None:
    """Reference: they must; neither by adding nor by the order of the two numbers are any two equal."""
    assert len({trial_seed(seed, number) for seed in range(30) for number in range(30)}) == 900
    assert new_search(SPACE, seed=1).ask() != new_search(SPACE, seed=2).ask()


@pytest.mark.parametrize("algorithm", ["tpe", "anneal"])
def test_the_minimum_of_a_quadratic_is_found(algorithm: Algorithm) -> None:
    """Reference: closed form: the mean over the space is 2 x 8^2 / 12 + 1.5^2 + 0.5^2, which random search keeps to."""
    sides = Interval(-4.0, 4.0, log=False, integer=False)
    space = Space({"x": sides, "y": sides})

    def quadratic(point: Point) -> float:
        return (point["x"] - 1.5) ** 2 + (point["y"] + 0.5) ** 2

    for seed in range(3):
        search = Search(space, algorithm, num_startup=20, seed=seed, initial=())
        losses = [quadratic(point) for point in run(search, 80, quadratic)]
        assert min(losses) < min(min(losses[:20]) / 2, 0.2)
        assert np.mean(losses[-20:]) < 13.17 / 2


def draws(dimension: Interval | Options, num: int = 1500) -> list[Any]:
    space = Space({"key": dimension})
    search = new_search(space)
    return [space.values(search.ask())["key"] for _ in range(num)]


@pytest.mark.parametrize(
    ("dimension", "probabilities"),
    [
        (Interval(-1, 3, log=False, integer=True), dict.fromkeys(range(-1, 4), 1 / 5)),
        (Interval(1, 6, log=True, integer=True), {k: math.log((k + 0.5) / (k - 0.5), 13) for k in range(1, 7)}),
        (Options((1, 3, 5, 7), ("1", "3", "5", "7"), ordered=True), dict.fromkeys((1, 3, 5, 7), 1 / 4)),
        (Options(("a", "b", "c"), ("a", "b", "c"), ordered=False), dict.fromkeys("abc", 1 / 3)),
    ],
)
def test_frequencies(dimension: Interval | Options, probabilities: dict[Any, float]) -> None:
    """Reference: closed form; the ends are as frequent as the rest."""
    actual = draws(dimension)
    assert set(actual) == set(probabilities)
    expected = [1500 * probability for probability in probabilities.values()]
    assert stats.chisquare([actual.count(key) for key in probabilities], expected).pvalue > 0.01


def test_distributions() -> None:
    """Reference: closed form."""
    assert stats.kstest(draws(Interval(2.0, 5.0, log=False, integer=False)), "uniform", (2, 3)).pvalue > 0.01
    actual = np.log10(draws(Interval(1e-4, 1e-1, log=True, integer=False)))
    assert stats.kstest(actual, "uniform", (-4, 3)).pvalue > 0.01


dimensions = st.one_of(
    st.builds(
        lambda low, width: Interval(low, low + width, log=False, integer=False),
        low=st.floats(-1e6, 1e6),
        width=st.floats(1e-3, 1e6),
    ),
    st.builds(
        lambda low, factor: Interval(low, low * factor, log=True, integer=False),
        low=st.floats(1e-9, 1e6),
        factor=st.floats(1.001, 1e6),
    ),
    st.builds(
        lambda low, width, log: Interval(low, low + width, log=log, integer=True),
        low=st.integers(1, 1000),
        width=st.integers(1, 1000),
        log=st.booleans(),
    ),
    st.builds(
        lambda count, ordered: Options(tuple(range(count)), tuple(map(str, range(count))), ordered=ordered),
        count=st.integers(1, 9),
        ordered=st.booleans(),
    ),
)


@given(dimension=dimensions, algorithm=st.sampled_from(ALGORITHMS), seed=st.integers(0, 2**32))
@settings(deadline=None, max_examples=50)
def test_values_lie_in_the_space(dimension: Interval | Options, algorithm: Algorithm, seed: int) -> None:
    """Reference: the limits; losses draw the search to one of them."""
    space = Space({"key": dimension})
    search = Search(space, algorithm, num_startup=4, seed=seed, initial=())
    for number in range(8):
        point = search.ask()
        value = space.values(point)["key"]
        if isinstance(dimension, Interval):
            assert dimension.low <= value <= dimension.high
            assert type(value) is (int if dimension.integer else float)
        else:
            assert value in dimension.values
        assert space.values(space.point({"key": value}, "here"))["key"] == value
        search.tell(number, (-1) ** seed * float(point["key"]))
