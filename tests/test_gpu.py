"""`make gpu` on a CPU at toy size, its arithmetic, and that an update can be captured as a CUDA graph."""

import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from affmap.control.agent import Agent, Observation
from affmap.model.lookup import AffordanceMap

FOLDER = Path(__file__).parent / "benchmarks"
REFERENCE = FOLDER.parents[1] / "runs" / "reference" / "store" / "train"
SIZES = [0, 1, 3, 5, 8, 16, 32]


@pytest.fixture(scope="module")
def load() -> Iterator[Any]:
    """Import a module of the benchmarks, as `python tests/benchmarks/gpu.py` does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        yield __import__


@pytest.fixture(scope="module")
def jobs(load: Any) -> Any:
    """The trainings of Experiment V at toy size, one for each context size."""
    paper, scale = load("paper"), load("workloads").TOY
    return paper.trainings(paper.jobs(scale.overrides, ["exp5"]))


@pytest.fixture(scope="module")
def own(load: Any, jobs: Any) -> Any:
    """Their batches."""
    workloads = load("workloads")
    return workloads.batches(jobs[0], workloads.TOY)


def test_everything_runs_at_toy_size(
    load: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The CPU beside itself: padded batches change weights by rounding, and plans not at all."""
    monkeypatch.setattr("sys.argv", ["gpu", "--device", "cpu", "--toy", "--output", str(tmp_path)])
    load("gpu").main()
    checks, timings = (pd.read_csv(tmp_path / name) for name in ("checks.csv", "gpu.csv"))
    assert (checks["difference"] < [1e-6, 1e-6, 1e-12, 1e-12]).all()
    sizes = [f"training, context size {size}" for size in SIZES for _ in range(3)]
    on_both = ["planning, 2 agents", "planning, 4 agents", "control, cem", "control, gradient"]
    works = [*sizes, "training, all context sizes", *(work for work in on_both for _ in range(2))]
    assert timings["work"].tolist() == [*works, *["the whole paper"] * 8]
    assert (timings["seconds"] > 0).all() and (timings["timed"][: len(works)] > 0).all()
    assert json.loads((tmp_path / "machine.json").read_text())["card"] == load("machine").card()
    assert "side by side, then plain" in capsys.readouterr().out


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU that PyTorch can use")
def test_without_a_card_there_is_a_sentence(
    load: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With what torch is there, and the remedy; nothing is written."""
    monkeypatch.setattr("sys.argv", ["gpu"])
    with pytest.raises(SystemExit):
        load("gpu").main()
    assert f"torch {torch.__version__} finds no card; install a build of torch for CUDA" in capsys.readouterr().err


def test_the_paper_is_counted_from_its_configuration(load: Any) -> None:
    """Its trainings are those of the reference run, but for 10 of VI, 1 of VII, 10 of VIII, 6 of IX; updates by hand.

    Steps, too. Trainings of 16 batches of 6 chunks: 15 of 50 epochs, 1 of 100; of four times as many batches 7 of 500.
    Flights of 200 steps: of 5 context sizes two planners in Experiment I, two more worlds in II, one in III and one in
    IV; of 7 sizes two in V; those of the model whose maps are seen to grow.
    """
    paper, gpu = load("paper"), load("gpu")
    jobs = paper.jobs()
    digests = {paper.TRAIN.of(job).digest for job in paper.trainings(jobs)}
    kept = {path.name for path in REFERENCE.iterdir()}
    assert digests < kept and len(kept - digests) == 27
    timings = [
        gpu.Timing(f"training, context size {size}", contender, "update", seconds, 1)
        for size in SIZES
        for contender, seconds in ((gpu.PLAIN, 1.0), (gpu.GRAPH, 0.1), (gpu.CPU, 0.5))
    ]
    timings.append(gpu.Timing("training, all context sizes", gpu.TOGETHER, "update of each", 0.35, 1))
    timings += [
        gpu.Timing(f"control, {planner}", contender, "step of each", factor * seconds, 1)
        for planner, seconds in (("cem", 2.0), ("gradient", 3.0))
        for contender, factor in ((gpu.PLAIN, 1), (gpu.CPU, 4))
    ]
    rows = gpu.whole_paper(jobs, timings)
    updates = 16 * 6 * (15 * 50 + 100) + 64 * 6 * 7 * 500
    flights = 200 * ((5 + 10 + 5 + 5 + 14 + 1) * 2.0 + 5 * 3.0)
    together, loops = updates * 0.1 / 2, updates * 0.5
    on_both = [flights, flights * 4, together + flights, loops + flights * 4]
    expected = [updates, updates * 0.1, together, loops, *on_both]
    assert [row.seconds for row in rows] == pytest.approx(expected)


def test_a_padded_batch_is_the_batch(load: Any, own: Any) -> None:
    """All pixels of all windows of its views, and all else, bit for bit; batches do differ in size."""
    epoch = load("graphs").Epoch.of(own, "cpu")
    assert len({len(batch.views.window_ids) for batch in own}) > 1
    for number, batch in enumerate(own):
        padded = epoch.batch(torch.tensor([number]))
        for one, other in zip(padded[1:4], batch[1:4], strict=True):
            assert torch.equal(one, other)
        pixels = [v.patches[v.patch_ids[v.window_ids[v.ids]]] for v in (padded.views, batch.views)]
        assert torch.equal(*pixels)


def test_a_training_takes_the_batches_in_turns_and_adds_up_losses(load: Any, jobs: Any, own: Any) -> None:
    """A loop over the batches as they are, begun again at the end."""
    graphs, training = load("graphs"), load("training")
    trained = graphs.Training(jobs[1], graphs.Epoch.of(own[:2], "cpu"))
    module = training.TrainingModule(graphs.untrained(jobs[1]), jobs[1].training)
    optimizer = module.configure_optimizers()
    total = torch.zeros(2)
    for batch in (*own[:2], own[0]):
        trained.update()
        total += module.update(batch, optimizer)
    torch.testing.assert_close(trained.nll, total)


def test_compiled_loops_train_as_pytorch_does(load: Any, jobs: Any, own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The CPU's contender after more updates than there are batches: the weights of `Training`, to rounding."""
    graphs, workloads, modules = load("graphs"), load("workloads"), []

    def module(*arguments: Any) -> Any:
        modules.append(graphs.TrainingModule(*arguments))
        return modules[-1]

    monkeypatch.setattr(workloads, "TrainingModule", module)
    update, trained = workloads.cpu_training(jobs[4], own), graphs.Training(jobs[4], graphs.Epoch.of(own, "cpu"))
    for _ in range(len(own) + 1):
        update()
        trained.update()
    for one, other in zip(modules[0].parameters(), trained.module.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-5)


def test_other_weights_are_noticed(load: Any, jobs: Any, own: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The CPU begins with weights of other seeds."""
    checks = load("checks")
    other = jobs[1].model_copy(update={"seed": 7})
    monkeypatch.setattr(checks, "untrained", lambda config: load("graphs").untrained(other))
    assert all(check.difference > check.allowed for check in checks.training(jobs[1], own, "cpu"))


@pytest.mark.parametrize("number", [0, 4])
def test_an_update_waits_for_nothing(
    load: Any, jobs: Any, own: Any, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a capture demands: on tensors without values, any look at one raises, and so does most that is on the CPU.

    Adam is left out: fused, it knows real devices only.
    """
    graphs = load("graphs")
    monkeypatch.setattr(
        graphs.TrainingModule, "configure_optimizers", lambda self: torch.optim.SGD(self.parameters(), lr=0.1)
    )
    training = graphs.Training(jobs[number], graphs.Epoch.of(own, "meta"))
    training.update()
    assert all(parameter.is_meta for parameter in training.module.parameters())
    with pytest.raises((RuntimeError, NotImplementedError)):
        training.nll.sum().item()


def test_a_plan_stays_on_its_device(load: Any) -> None:
    """A whole search by the cross-entropy method on tensors without values; NumPy draws its random numbers."""
    workloads = load("workloads")
    agent = workloads.make_agent(workloads.TOY, 2, "cem", "cpu")
    start = Observation(*(part.to("meta") for part in workloads.first_observation(agent)))
    painted = AffordanceMap(agent.lookup.codes.to("meta"), agent.lookup.worlds)
    moved = Agent(agent.stack.to("meta"), painted, agent.planner, agent.settings)
    objective, state = moved.objective(start), agent.planner.initial(4, "meta")
    plan, _ = agent.planner.plan(objective, state, workloads.generators(agent))
    assert plan.actions.is_meta and plan.cost.shape == (4,)


def test_a_graph_is_warmed_up_and_captured_on_its_own_stream(
    load: Any, jobs: Any, own: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The order of PyTorch's manual (Whole-network capture), with a card that only notes what it is asked for."""
    graphs, notes = load("graphs"), []

    class Stream:
        def wait_stream(self, other: Any) -> None:
            notes.append("wait")

    class Fake(graphs.Training):
        def update(self) -> None:
            super().update()
            notes.append("update")

        def prepare_capture(self) -> None:
            super().prepare_capture()
            groups = self._optimizer.param_groups
            assert all(group["capturable"] for group in groups)
            assert all(parameter.grad is None for group in groups for parameter in group["params"])
            notes.append("prepare")

    def on(stream: Stream) -> Any:
        notes.append("on stream")
        return nullcontext()

    def capture(graph: Any, stream: Stream) -> Any:
        notes.append("capture")
        return nullcontext()

    graph = SimpleNamespace(replay=lambda: notes.append("replay"))
    for name, value in {"Stream": Stream, "current_stream": Stream, "stream": on, "graph": capture}.items():
        monkeypatch.setattr(torch.cuda, name, value)
    monkeypatch.setattr(torch.cuda, "CUDAGraph", lambda: graph)
    graphs.Graph(Fake(jobs[4], graphs.Epoch.of(own, "cpu")))()
    warm_up = ["wait", "on stream", *["update"] * graphs.WARM_UP, "wait"]
    assert notes == [*warm_up, "prepare", "capture", "update", "on stream", "replay"]


def test_a_stopwatch_divides_by_what_it_has_timed(load: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: 0.25 s a call, and 5 s to pass in bursts of 10."""
    gpu, clock = load("gpu"), [0.0]
    monkeypatch.setattr(gpu.time, "perf_counter", lambda: clock[0])

    def run() -> None:
        clock[0] += 0.25

    timing = gpu.Stopwatch("cpu", 4.0).time("work", "contender", "unit", run)
    assert (timing.seconds, timing.timed) == (0.25, 20)
    assert np.isclose(clock[0], 7.5)
