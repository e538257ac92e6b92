from typing import Any

import numpy as np
import pytest
import torch
from hydra.core.utils import JobReturn, JobStatus

from hydra_plugins.hyperopt_sweeper._outcomes import Outcome, outcomes


def returned(value: Any) -> JobReturn:
    return JobReturn(status=JobStatus.COMPLETED, _return_value=value)


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2), np.array(2), torch.tensor(2)])
def test_numbers_of_all_kinds(value: Any) -> None:
    """Reference: float."""
    assert outcomes([returned(value)], 1, stacked=False) == [Outcome(2.0)]


@pytest.mark.parametrize(
    ("value", "error"),
    [
        (None, "returned None, which is no number"),
        ("1.0", "returned '1.0', which is no number"),
        (True, "returned True, which is no number"),
        ([1.0], r"returned [1.0], which is no number"),
        (torch.ones(2), "returned tensor([1., 1.]), which is no number"),
        (float("nan"), "returned nan, which is not finite"),
        (-float("inf"), "returned -inf, which is not finite"),
    ],
)
def test_what_is_no_result(value: Any, error: str) -> None:
    """Reference: written by hand; alone, and within a stack, where it concerns a single trial."""
    assert outcomes([returned(value)], 1, stacked=False) == [Outcome(None, error)]
    assert outcomes([returned([1, value])], 2, stacked=True) == [Outcome(1.0), Outcome(None, error)]


@pytest.mark.parametrize("value", [None, 1.0, [1.0, 2.0], torch.ones(2)])
def test_a_stack_returns_as_many_results_as_trials(value: Any) -> None:
    """Reference: written by hand; none can be assigned, so all failed."""
    actual = outcomes([returned(value)], 3, stacked=True)
    error = f"returned {value!r}, which is not a list of results, one for each of 3 trials"
    assert actual == [Outcome(None, error)] * 3


def test_arrays_are_lists_of_results() -> None:
    """Reference: their elements."""
    for array in (np.array([1.0, 2.0]), torch.tensor([1.0, 2.0]), (1, 2)):
        assert outcomes([returned(array)], 2, stacked=True) == [Outcome(1.0), Outcome(2.0)]


def test_exceptions() -> None:
    """Reference: what was raised."""
    error = ValueError("too large")
    failed = JobReturn(status=JobStatus.FAILED, _return_value=error)
    outcome = Outcome(None, "ValueError: too large", error)
    assert outcomes([failed, returned(1)], 2, stacked=False) == [outcome, Outcome(1.0)]
    assert outcomes([failed], 2, stacked=True) == [outcome, outcome]
