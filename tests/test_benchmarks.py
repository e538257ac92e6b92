"""All parts of the benchmarks at toy size, their arithmetic, and that they compare equal work; no time is tested."""

import runpy
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch

FOLDER = Path(__file__).parent / "benchmarks"

TOY: Mapping[str, Mapping[str, Any]] = {
    "training": {"MEMBERS": 2, "TRIALS": 2, "TRIAL_MEMBERS": 1},
    "growth": {
        "MEMBERS": 2,
        "VARIED": {"members": (1, 2), "context_size": (0, 8), "channels": (1, 2)},
        "ROUNDS": 1,
        "SECONDS": 0.1,
    },
    "lookups": {"MEMBERS": 2, "POSITIONS": 20, "SPACINGS": (0.1, 0.2)},
}
"""Module -> its sizes; those of the others are small anyway."""


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import a module of the benchmarks, as `python tests/benchmarks` does."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return __import__


@pytest.mark.filterwarnings("ignore")  # as `make bench` does
@pytest.mark.parametrize(
    ("part", "num_contenders", "extra", "num_rows"),
    [
        ("training", [3, 2, 2], "growth", 2 + 2 + 2 + 3),
        ("planning", [2, 4, 5, 2, 2], "costs", 1),
        ("simulation", [4, 2], "control_step", 4),
        ("lookups", [4, 2, 2], "maps", 2),
    ],
)
def test_every_part_runs_at_toy_size(
    load: Any,
    part: str,
    num_contenders: list[int],
    extra: str,
    num_rows: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The program itself: contenders of each work by hand, and the peers that are installed; tables and the figure."""
    for module, sizes in TOY.items():
        for name, size in sizes.items():
            monkeypatch.setattr(load(module), name, size)
    if part == "planning":
        peers = load("peers").available()
        batched = sum(peer.batched for peer in peers)
        num_contenders = [2 + 2 * len(peers), 4 + len(peers) + 2 * batched, 5, 2, 2]
        num_rows += len(peers)
    monkeypatch.setattr(sys, "argv", ["benchmarks", part, "--rounds", "1", "--output", str(tmp_path)])
    runpy.run_path(str(FOLDER), run_name="__main__")
    results, rows = (pd.read_csv(tmp_path / f"{name}.csv") for name in ("results", extra))
    assert results.groupby("work", sort=False).size().tolist() == num_contenders
    assert (results["seconds"] > 0).all() and len(rows) == num_rows
    assert {path.name for path in tmp_path.iterdir()} == {
        *("machine.json", "results.csv", f"{extra}.csv"),
        *("bench.png", "bench.pdf", "provenance.json"),
    }
    assert f"Written to {tmp_path}" in capsys.readouterr().out.replace("\n", "")


def test_a_part_that_there_is_not_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sentence names it, and those there are."""
    monkeypatch.setattr(sys, "argv", ["benchmarks", "juggling"])
    with pytest.raises(SystemExit):
        runpy.run_path(str(FOLDER), run_name="__main__")
    assert "juggling: there is no such part; choose from training, planning" in capsys.readouterr().err


def test_ratios_are_those_of_neighbouring_times(load: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: a machine that is slower in some rounds than in others, and a peer whose lead changes, too.

    Seconds a unit are 1, 4, 2 of ours and 2, 36, 6 of the peer: the median of ratios is 3, the ratio of medians is not.
    """
    measure = load("measure")
    clock, rounds = [0.0], iter([(1.0, 2.0), (4.0, 9.0), (2.0, 3.0)])
    machine, peer = [1.0], [1.0]

    def work(seconds: float) -> None:
        clock[0] += seconds

    def limit() -> float:
        machine[0], peer[0] = next(rounds)
        return 100.0 / machine[0]

    monkeypatch.setattr(measure.time, "process_time", lambda: clock[0])
    monkeypatch.setattr(measure, "limit", limit)
    contenders = [
        measure.Contender("ours", lambda: work(4 * machine[0]), 4),
        measure.Contender("peer", lambda: work(2 * machine[0] * peer[0]), 2),
    ]
    ours, other = measure.compare("work", "unit", contenders, flop=10.0, rounds=3)
    assert (ours.seconds, other.seconds) == (2.0, 6.0)
    assert (ours.ratio, ours.ratio_low, ours.ratio_high) == (1.0, 1.0, 1.0)
    assert (other.ratio, other.ratio_low, other.ratio_high) == (3.0, 2.0, 9.0)
    assert ours.share_of_limit == pytest.approx(10 / 100) and other.share_of_limit == pytest.approx(10 / 3 / 100)


def test_views_and_windows_of_an_update_are_as_few_as_the_page_on_speed_says(load: Any) -> None:
    """Means over the batches of an epoch, to the nearest ten."""
    seen = [batch.views for batch in load("flights").batches()]
    assert {windows.ids.numel() for windows in seen} == {500}
    views, windows = (
        round(sum(numbers) / len(seen), -1)
        for numbers in ([len(each.window_ids) for each in seen], [len(each.patch_ids) for each in seen])
    )
    speed = " ".join(FOLDER.parents[1].joinpath("docs/speed.md").read_text("utf-8").split())
    assert f"the 500 views of an update contain about {views:.0f} distinct ones" in speed
    assert f"consist of about {windows:.0f} distinct windows" in speed


def test_what_was_measured_is_drawn(load: Any) -> None:
    """A bar for every contender but the first of each work."""
    measure, figure = load("measure"), load("figure")
    row = measure.Result("training", "update", "plain PyTorch", 4e-3, 12.0, 11.0, 13.0, 0.03)
    rows = [row._replace(contender="ours", seconds=3e-4, ratio=1.0), row, row._replace(contender="another", ratio=0.5)]
    drawn = figure.draw(rows, None)
    assert [bar.get_width() for bar in drawn.axes[0].patches] == [11.0, -0.5]


def test_control_is_taken_apart(load: Any) -> None:
    """The parts of a step are all of it."""
    parts = load("simulation").control_step(members=1, num_steps=3)
    assert parts["share"].sum() == pytest.approx(1) and (parts["milliseconds"] > 0).all()


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
