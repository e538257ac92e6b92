"""The register of metrics; that one shows in reports is tested in `tests/cli/test_extensions.py`."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from affmap.results.files import Trajectories
from affmap.results.metrics import METRICS, Metric, extra_metrics, register_metric, stored_metrics, summarise
from affmap.settings import ConfigError


@pytest.fixture(autouse=True)
def table() -> Iterator[None]:
    """What a test registers is gone afterwards."""
    before = dict(METRICS)
    yield
    METRICS.clear()
    METRICS.update(before)


PATHS = Trajectories(
    **{key: np.zeros((3, 2)) for key in Trajectories._fields if key not in ("action", "run")},
    action=np.arange(24.0).reshape(3, 2, 4),
    run=np.arange(3),
)
"""Three runs of two steps, as far as they matter here."""


def effort(paths: Trajectories) -> NDArray[np.floating]:
    return paths.action.sum(axis=2).mean(axis=1)


def test_a_registered_metric_is_computed_and_not_stored() -> None:
    """By hand: throttles 0 to 7, 8 to 15 and 16 to 23, four a step. Defined anew, it is the new one."""
    before = stored_metrics()
    register_metric("effort", Metric("effort", "throttles", "open throttles", effort))
    assert stored_metrics() == before and extra_metrics() == ["effort"]
    assert summarise(PATHS, ["effort"])["effort"].tolist() == [14, 46, 78]
    register_metric("effort", Metric("effort", "throttles", "closed throttles", lambda paths: 4 - effort(paths)))
    assert extra_metrics() == ["effort"] and summarise(PATHS, ["effort"])["effort"].tolist() == [-10, -42, -74]


@pytest.mark.parametrize("shape", [(), (2,), (3, 2)])
def test_another_number_of_values_is_told(shape: tuple[int, ...]) -> None:
    register_metric("effort", Metric("effort", "throttles", "open throttles", lambda _: np.zeros(shape)))
    with pytest.raises(ConfigError, match=r"^the metric 'effort' returned shape \[.*\]; it should .* run, \[3\]\.$"):
        summarise(PATHS, ["effort"])


@pytest.mark.parametrize("column", ["reached", "goal_x", "crossable", "Effort", "a b", "2nd", "", effort])
def test_a_name_that_is_taken_or_no_column_is_refused(column: Any) -> None:
    with pytest.raises(ValueError, match=r"needs a name of its own.*; there are: crossable, final_spread"):
        register_metric(column, Metric("effort", "throttles", "open throttles", effort))


@pytest.mark.parametrize("wrong", [effort, "effort", None])
def test_something_else_than_a_metric_is_refused(wrong: Any) -> None:
    with pytest.raises(
        ValueError, match=r"^the metric 'effort' is .*; give affmap\.Metric\(name, unit, label, function\)"
    ):
        register_metric("effort", wrong)
    assert extra_metrics() == []


def test_a_metric_that_cannot_be_computed_later_is_refused() -> None:
    metric = Metric("effort", "throttles", "open throttles", effort)
    for wrong in (replace(metric, of_runs=None), replace(metric, stored=True)):
        with pytest.raises(ValueError, match="'effort' needs a function of trajectories"):
            register_metric("effort", wrong)
