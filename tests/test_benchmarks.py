"""The benchmarks' arithmetic against a clock that is known, and that they compare equal work; nothing is timed here."""

from pathlib import Path
from typing import Any

import pytest
import torch

FOLDER = Path(__file__).parent / "benchmarks"


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import a module of the benchmarks, as `python tests/benchmarks` does."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return __import__


def test_ratios_are_those_of_neighbouring_times(load: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: a machine that gets slower from round to round, and a contender that needs thrice as long."""
    measure = load("measure")
    clock, speed = [0.0], [0.0]

    def work(seconds: float) -> None:
        clock[0] += seconds * speed[0]

    def limit() -> float:
        speed[0] += 1.0  # a round begins
        return 100.0 / speed[0]

    monkeypatch.setattr(measure.time, "process_time", lambda: clock[0])
    monkeypatch.setattr(measure, "limit", limit)
    contenders = [
        measure.Contender("ours", lambda: work(2.0), 4),  # half a second a unit
        measure.Contender("peer", lambda: work(3.0), 2),
    ]
    ours, peer = measure.compare("work", "unit", contenders, flop=10.0, rounds=3)
    assert (ours.seconds, peer.seconds) == (1.0, 3.0)  # of the round in the middle
    assert (ours.ratio, ours.ratio_low, ours.ratio_high) == (1.0, 1.0, 1.0)
    assert (peer.ratio, peer.ratio_low, peer.ratio_high) == (3.0, 3.0, 3.0)
    assert ours.share_of_limit == pytest.approx(10 / 0.5 / 100) and peer.share_of_limit == pytest.approx(10 / 1.5 / 100)


def test_the_plain_model_does_the_same_work(load: Any) -> None:
    """Equal losses on equal batches; and other weights are noticed."""
    training, flights = load("training"), load("flights")
    stack = training.make_stack(3, 8)
    model = training.PlainModel(stack)
    own, plain = flights.batches()[0], flights.plain_batches()[0]
    training.check(stack, own, model, plain)
    with torch.no_grad():
        model.mean.bias += 0.1
    with pytest.raises(RuntimeError, match="they do different work"):
        training.check(stack, own, model, plain)
