"""A training from start to end: against a plain loop, against itself undisturbed, against the member alone."""

import io
import os
import shutil
import signal
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import lightning
import numpy as np
import pandas as pd
import pytest
import torch
from torch.distributions import Normal
from traces import Trace

from affmap import compiled
from affmap.data.batches import DataModule, read
from affmap.data.collect import Exploration, collect
from affmap.env import Layout, Vehicle
from affmap.model.stack import ModelSettings, Stack
from affmap.model.weights import copy, restore, save
from affmap.random import generator
from affmap.results.files import read_validation
from affmap.settings import ConfigError
from affmap.training.fit import OnEpoch, fit, keep, last
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

EXPLORATION = Exploration.load("data", "default", num_sequences=8, num_validation=3, num_steps=24)
SETTINGS = TrainingSettings.load("training", "default", num_epochs=4, batch_size=2, chunk_length=10)
BATCHES_PER_EPOCH = 9  # batches of 2, 2 and 1 sequences, chunks of 10, 10 and 4 steps
TRIALS = SETTINGS.model_copy(
    update={
        "transition_lr": (0.008, 0.02, 0.001),
        "vision_lr": (0.003, 0.00075, 0.0001),
        "vision_max_norm": (2, 0.1, 9),
    }
)
"""Three trials; the norm of the transition model is the same for all."""
Weights = dict[str, torch.Tensor]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "dataset.npz"
    arrays = collect([Layout.load("layout", "original")], Vehicle.load("vehicle", "default"), EXPLORATION)
    np.savez(path, allow_pickle=False, **arrays)
    return path


def stack(seeds: tuple[int, ...] = (4, 5, 6), context_size: int = 3) -> Stack:
    return Stack(ModelSettings.load("model", "default", context_size=context_size), 1, seeds)


def train(
    dataset: Path,
    folder: Path,
    seeds: tuple[int, ...] = (4, 5, 6),
    settings: TrainingSettings = SETTINGS,
    on_epoch: OnEpoch = lambda epoch, validation_nll: None,
    board: Path | None = None,
) -> Path:
    checkpoints = folder / "checkpoints"
    checkpoints.mkdir(parents=True, exist_ok=True)
    data = DataModule(dataset, EXPLORATION, settings.batch_size, settings.chunk_length)
    fit(stack(seeds), data, settings, folder, checkpoints, on_epoch, board)
    return folder


def weights(path: Path, seeds: tuple[int, ...] = (4, 5, 6)) -> Weights:
    return restore(stack(seeds), path).state_dict()


@pytest.fixture(scope="module")
def undisturbed(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train(dataset, tmp_path_factory.mktemp("undisturbed"))


FILES = {"weights.safetensors", "validation.csv", *(f"weights-epoch-00{epoch}.safetensors" for epoch in (1, 2, 4))}


def assert_same(folder: Path, undisturbed: Path) -> None:
    """The same files with the same bytes, and a single checkpoint."""
    assert {path.name for path in folder.iterdir()} == {*FILES, "checkpoints"}
    assert len(list((folder / "checkpoints").iterdir())) == 1
    for name in FILES:
        assert (folder / name).read_bytes() == (undisturbed / name).read_bytes(), name


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU that PyTorch can use")
def test_a_gpu_trains_what_the_cpu_trains(dataset: Path, undisturbed: Path, tmp_path: Path) -> None:
    """The losses of the first epoch, before rounding has grown."""
    folder = train(dataset, tmp_path, settings=SETTINGS.model_copy(update={"accelerator": "gpu"}))
    found, expected = (pd.read_csv(each / "validation.csv").query("epoch == 1") for each in (folder, undisturbed))
    np.testing.assert_allclose(found.to_numpy(), expected.to_numpy(), atol=1e-2)
    assert weights(folder / "weights.safetensors").keys() == weights(undisturbed / "weights.safetensors").keys()


def test_snapshots_are_of_the_epochs_named_and_the_last(dataset: Path, undisturbed: Path, tmp_path: Path) -> None:
    """A training that ends after two epochs has the weights of the snapshot; the last snapshot is the result."""
    assert {path.name for path in undisturbed.iterdir()} == {*FILES, "checkpoints"}
    short = train(dataset, tmp_path, settings=SETTINGS.model_copy(update={"num_epochs": 2}))
    for name, weight in weights(short / "weights.safetensors").items():
        assert torch.equal(weight, weights(undisturbed / "weights-epoch-002.safetensors")[name])
        assert torch.equal(
            weights(undisturbed / "weights-epoch-004.safetensors")[name],
            weights(undisturbed / "weights.safetensors")[name],
        )
    assert not (short / "weights-epoch-004.safetensors").exists()


def test_training_is_a_plain_loop(dataset: Path, undisturbed: Path) -> None:
    """Appendix A written down for one member with PyTorch alone: two Adams, clipping, shuffled sequences in chunks."""
    model, data = stack((5,)), read(dataset)
    assert model.vision is not None
    parts = [(model.transition, 0.008, 1.2), (model.vision, 0.00075, 2.0)]
    adams = [torch.optim.Adam(part.parameters(), lr, (0.9, 0.999), 1e-4) for part, lr, _ in parts]
    training_nll, validation_nll = [], []

    def loss(sequences: list[int], start: int, end: int) -> torch.Tensor:
        cut = (slice(None), sequences, slice(start, end))
        code = model.encode(data.views.select(cut))
        _, (mean, log_std) = model.transition.unroll((), code, data.delta[cut], data.action[cut])
        return -Normal(mean, log_std.exp()).log_prob(data.target[cut]).sum(-1).mean()

    for epoch in range(4):
        order, losses = generator(0, "batch order", epoch).permutation(5).tolist(), []
        for first in (0, 2, 4):
            for start in (0, 10, 20):
                value = loss(order[first : first + 2], start, min(start + 10, 24))
                for adam in adams:
                    adam.zero_grad()
                value.backward()
                for (part, _, max_norm), adam in zip(parts, adams, strict=True):
                    torch.nn.utils.clip_grad_norm_(part.parameters(), max_norm)
                    adam.step()
                losses.append(value.item())
        training_nll.append(np.mean(losses))
        with torch.no_grad():
            validation_nll.append(loss([5, 6, 7], 0, 24).item())
    for name, weight in weights(undisturbed / "weights.safetensors").items():
        torch.testing.assert_close(weight[1], model.state_dict()[name][0], rtol=1e-3, atol=1e-4, msg=name)
    table = pd.read_csv(undisturbed / "validation.csv").query("member == 5")
    np.testing.assert_allclose(table["training_nll"], training_nll, atol=1e-3)
    np.testing.assert_allclose(table["validation_nll"], validation_nll, atol=1e-3)
    assert np.ptp(validation_nll) > 0.1


def test_without_compiled_loops_pytorch_trains_the_same(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Losses to float rounding; a training killed in the middle is, bit by bit, one that was not."""
    monkeypatch.setattr(compiled, "_switch", False)
    whole = train(dataset, tmp_path / "whole")
    killed(dataset, tmp_path / "killed", monkeypatch, 2 * BATCHES_PER_EPOCH + 5)
    assert_same(train(dataset, tmp_path / "killed"), whole)
    found, expected = (pd.read_csv(folder / "validation.csv").to_numpy() for folder in (whole, undisturbed))
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_the_table_of_losses(undisturbed: Path) -> None:
    """Columns, members and epochs by hand; numbers with six digits."""
    text = (undisturbed / "validation.csv").read_text()
    table = pd.read_csv(io.StringIO(text))
    assert text.startswith("member,epoch,training_nll,validation_nll\n4,1,")
    assert table[["member", "epoch"]].to_numpy().tolist() == [[m, e] for m in (4, 5, 6) for e in (1, 2, 3, 4)]
    assert np.isfinite(table.to_numpy()).all()
    assert table["validation_nll"].nunique() == 12


def test_validation_is_the_mean_over_all_validation_steps(dataset: Path, undisturbed: Path) -> None:
    """By hand with the weights of each snapshot, over the last three sequences; chunks and batches differ in size."""
    table = pd.read_csv(undisturbed / "validation.csv").set_index(["epoch", "member"])["validation_nll"]
    data = read(dataset)
    cut = (slice(None), slice(5, 8))
    for epoch in (1, 2, 4):
        model = restore(stack(), undisturbed / f"weights-epoch-00{epoch}.safetensors")
        with torch.no_grad():
            code = model.encode(data.views.select(cut))
            _, (mean, log_std) = model.transition.unroll((), code, data.delta[cut], data.action[cut])
        nll = -Normal(mean, log_std.exp()).log_prob(data.target[cut]).sum(-1).mean((1, 2))
        np.testing.assert_allclose(table[epoch], nll, atol=2e-5)


def test_a_checkpoint_counts_updates(undisturbed: Path) -> None:
    """By hand: four epochs; a step of Lightning's is several updates."""
    (path,) = (undisturbed / "checkpoints").iterdir()
    assert torch.load(path, weights_only=True)["global_step"] == 4 * BATCHES_PER_EPOCH


def test_a_member_trained_in_a_stack_is_the_seed_trained_alone(
    dataset: Path, undisturbed: Path, tmp_path: Path
) -> None:
    """To float rounding: matrices of other sizes are summed in another order."""
    alone = train(dataset, tmp_path, (6,))
    for name, weight in weights(alone / "weights.safetensors", (6,)).items():
        torch.testing.assert_close(weights(undisturbed / "weights.safetensors")[name][2:], weight, rtol=1e-3, atol=1e-4)
    together, single = (pd.read_csv(folder / "validation.csv") for folder in (undisturbed, alone))
    expected = together.query("member == 6").to_numpy()
    np.testing.assert_allclose(single.to_numpy(), expected, atol=1e-3)


@pytest.fixture(scope="module")
def trials(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train(dataset, tmp_path_factory.mktemp("trials"), 3 * (4, 5), TRIALS)


def test_a_trial_in_a_stack_is_the_training_alone(dataset: Path, trials: Path, tmp_path: Path) -> None:
    """Each trial's numbers as the only ones, without lists; to float rounding."""
    found = weights(trials / "weights.safetensors", 3 * (4, 5))
    together = pd.read_csv(trials / "validation.csv")
    for trial in range(3):
        own = {key: values[trial] for key, values in TRIALS.per_trial.items()}
        alone = train(dataset, tmp_path / str(trial), (4, 5), SETTINGS.model_copy(update=own))
        for name, weight in weights(alone / "weights.safetensors", (4, 5)).items():
            part = found[name][2 * trial : 2 * trial + 2]
            torch.testing.assert_close(part, weight, rtol=1e-3, atol=1e-4, msg=f"{trial}, {name}")
        expected = pd.read_csv(alone / "validation.csv")
        part = together[together["trial"] == trial].drop(columns="trial")
        np.testing.assert_allclose(part.to_numpy(), expected.to_numpy(), atol=1e-3)
    assert together.query("epoch == 4 and member == 4")["validation_nll"].std() > 0.1


def test_the_table_of_losses_of_trials(trials: Path) -> None:
    """By hand: trials first, each with all of its members and epochs."""
    table = pd.read_csv(trials / "validation.csv")
    assert list(table.columns) == ["trial", "member", "epoch", "training_nll", "validation_nll"]
    expected = [[trial, member, epoch] for trial in range(3) for member in (4, 5) for epoch in range(1, 5)]
    assert table[["trial", "member", "epoch"]].to_numpy().tolist() == expected
    assert table["validation_nll"].nunique() == 24


def test_trials_begin_with_the_same_weights_and_a_list_of_one_is_a_trial(
    dataset: Path, undisturbed: Path, tmp_path: Path
) -> None:
    """The training without a list, to float rounding; its table has one column less."""
    assert all(torch.equal(weight[:2], weight[2:]) for weight in stack(2 * (4, 5)).state_dict().values())
    one = SETTINGS.model_copy(update={"vision_lr": (SETTINGS.vision_lr,), "transition_max_norm": (1.2,)})
    table = pd.read_csv(train(dataset, tmp_path, settings=one) / "validation.csv")
    assert (table.pop("trial") == 0).all()
    np.testing.assert_allclose(table.to_numpy(), pd.read_csv(undisturbed / "validation.csv").to_numpy(), atol=1e-3)


def test_a_trial_that_is_lost_takes_no_other_with_it(dataset: Path, trials: Path, tmp_path: Path) -> None:
    """The second trial with a learning rate that no training survives: bit by bit, the others do as before."""
    hopeless = TRIALS.model_copy(update={"transition_lr": (0.008, 1e4, 0.001)})
    found, expected = (
        pd.read_csv(folder / "validation.csv").set_index("trial")
        for folder in (train(dataset, tmp_path, 3 * (4, 5), hopeless), trials)
    )
    assert found.loc[1, "validation_nll"].isna().all()
    pd.testing.assert_frame_equal(found.loc[[0, 2]], expected.loc[[0, 2]], check_exact=True)


def test_members_that_are_no_whole_trials_are_refused(dataset: Path, tmp_path: Path) -> None:
    """Five of them for three trials."""
    with pytest.raises(ValueError, match="a stack of 5 members cannot be 3 trials"):
        train(dataset, tmp_path, (1, 2, 3, 4, 5), TRIALS)


class Killed(Exception):  # noqa: N818
    """Stands for a power cut."""


def killed(
    dataset: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    updates: int,
    seeds: tuple[int, ...] = (4, 5, 6),
    settings: TrainingSettings = SETTINGS,
) -> None:
    """A training that ends in the middle, after so many updates of its own."""
    counter = iter(range(updates))
    update = TrainingModule.update

    def stop(self: TrainingModule, *arguments: object) -> torch.Tensor:
        if next(counter, None) is None:
            raise Killed
        return update(self, *arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(TrainingModule, "update", stop)
        with pytest.raises(Killed):
            train(dataset, folder, seeds, settings)


def test_a_training_killed_once_or_twice_gives_what_it_would_have(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Undisturbed training, bit by bit; killed in the first epoch, in the middle of the third, and once more."""
    killed(dataset, tmp_path, monkeypatch, 5)
    assert not list(tmp_path.glob("checkpoints/*"))
    killed(dataset, tmp_path, monkeypatch, 2 * BATCHES_PER_EPOCH + 5)
    assert len(list(tmp_path.glob("checkpoints/*.ckpt"))) == 1
    killed(dataset, tmp_path, monkeypatch, BATCHES_PER_EPOCH + 1)  # now in the fourth
    epochs: list[tuple[int, float]] = []
    train(dataset, tmp_path, on_epoch=lambda *epoch: epochs.append(epoch))
    losses = read_validation(tmp_path).query("epoch == 4")["validation_nll"]
    assert epochs == [(4, pytest.approx(losses.median(), abs=1e-5))]  # nothing was trained again
    assert_same(tmp_path, undisturbed)


def test_trials_killed_in_the_middle_end_as_they_would_have(
    dataset: Path, trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Undisturbed training of the same trials, bit by bit; killed in the middle of the third epoch."""
    killed(dataset, tmp_path, monkeypatch, 2 * BATCHES_PER_EPOCH + 5, 3 * (4, 5), TRIALS)
    epochs: list[int] = []
    train(dataset, tmp_path, 3 * (4, 5), TRIALS, lambda epoch, _: epochs.append(epoch))
    assert epochs == [3, 4]
    assert_same(tmp_path, trials)


@pytest.mark.parametrize("done", [1, 3, 4])
def test_a_training_killed_between_epochs_gives_what_it_would_have(
    dataset: Path, undisturbed: Path, tmp_path: Path, done: int
) -> None:
    """Undisturbed training, bit by bit; also when the last epoch was done, and when the folder was moved since."""

    def stop(epoch: int, _: float) -> None:
        if epoch == done:
            raise Killed

    with pytest.raises(Killed):
        train(dataset, tmp_path / "here", on_epoch=stop)
    assert not (tmp_path / "here" / "weights.safetensors").exists()
    shutil.move(tmp_path / "here", tmp_path / "there")
    epochs: list[int] = []
    train(dataset, tmp_path / "there", on_epoch=lambda epoch, _: epochs.append(epoch))
    assert epochs == list(range(done + 1, 5))
    assert_same(tmp_path / "there", undisturbed)


def test_a_kill_while_the_checkpoint_is_written_costs_an_epoch_at_most(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The checkpoint before it is whole: undisturbed training, bit by bit."""
    write = lightning.Trainer.save_checkpoint

    def half(self: lightning.Trainer, path: Path) -> None:
        if list(tmp_path.glob("checkpoints/*.ckpt")):
            Path(path).write_bytes(b"PK half a checkpoint")
            raise Killed
        write(self, path)

    with monkeypatch.context() as patch:
        patch.setattr(lightning.Trainer, "save_checkpoint", half)
        with pytest.raises(Killed):
            train(dataset, tmp_path)
    epochs: list[int] = []
    train(dataset, tmp_path, on_epoch=lambda epoch, _: epochs.append(epoch))
    assert epochs == [2, 3, 4]
    assert_same(tmp_path, undisturbed)


@pytest.mark.parametrize("harm", [lambda content: content[:-100], lambda content: content[:900] + b"?" + content[901:]])
def test_a_corrupted_checkpoint_costs_epochs_and_nothing_else(
    dataset: Path,
    undisturbed: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    harm: Callable[[bytes], bytes],
) -> None:
    """Truncated, or a byte changed, which PyTorch would not notice: undisturbed training, bit by bit."""

    def stop(epoch: int, _: float) -> None:
        if epoch == 3:
            raise Killed

    with pytest.raises(Killed):
        train(dataset, tmp_path, on_epoch=stop)
    (checkpoint,) = tmp_path.glob("checkpoints/*.ckpt")
    checkpoint.write_bytes(harm(checkpoint.read_bytes()))
    epochs: list[int] = []
    train(dataset, tmp_path, on_epoch=lambda epoch, _: epochs.append(epoch))
    assert epochs == [1, 2, 3, 4] and f"{checkpoint} is corrupted; without it" in caplog.text
    assert_same(tmp_path, undisturbed)


def test_the_newest_of_two_checkpoints_is_taken(tmp_path: Path) -> None:
    """As a kill leaves them after the second is written and before the first is removed."""
    assert last(tmp_path) is None
    kept = []
    for content in (b"first", b"second"):
        keep(tmp_path, lambda path, content=content: path.write_bytes(content))
        (path,) = tmp_path.iterdir()
        assert last(tmp_path) == path and path.read_bytes() == content
        kept.append((path, content))
    kept[0][0].write_bytes(b"first")
    os.utime(kept[0][0], ns=(1, 1))
    assert last(tmp_path) == kept[1][0]


def scalars(board: Path) -> dict[str, list[tuple[int, float]]]:
    """Tag -> (step, value) of all that TensorBoard reads in a folder, by its own reader."""
    reader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = reader.EventAccumulator(str(board), {reader.SCALARS: 0})
    events.Reload()
    return {tag: [(each.step, each.value) for each in events.Scalars(tag)] for tag in events.Tags()["scalars"]}


def quartiles(table: pd.DataFrame) -> dict[str, list[tuple[int, float]]]:
    """The same of a table of losses, by pandas."""
    expected = {}
    for name in ("training_nll", "validation_nll"):
        for quartile, level in (("lower_quartile", 0.25), ("median", 0.5), ("upper_quartile", 0.75)):
            expected[f"{name}/{quartile}"] = [*table.groupby("epoch")[name].quantile(level).items()]
    return expected


def assert_shown(found: dict[str, list[tuple[int, float]]], expected: dict[str, list[tuple[int, float]]]) -> None:
    """The same tags and epochs, each once, and the same values to the decimals of a table."""
    assert found.keys() == expected.keys()
    for tag, values in expected.items():
        np.testing.assert_allclose(found[tag], values, rtol=1e-6, atol=1e-6, err_msg=tag)


def test_tensorboard_reads_what_the_table_says_and_nothing_else_changes(
    dataset: Path, undisturbed: Path, tmp_path: Path
) -> None:
    """TensorBoard's own reader against pandas; the results of a training that nobody watches, byte by byte."""
    pytest.importorskip("tensorboard")
    assert_same(train(dataset, tmp_path / "run", board=tmp_path / "board"), undisturbed)
    assert_shown(scalars(tmp_path / "board"), quartiles(pd.read_csv(undisturbed / "validation.csv")))


@pytest.mark.parametrize("done", [1, 3, 4])
def test_tensorboard_sees_every_epoch_once_after_an_interruption(
    dataset: Path, undisturbed: Path, tmp_path: Path, done: int
) -> None:
    """Also where the power went before the events were on the disk, and when the last epoch was done."""
    pytest.importorskip("tensorboard")

    def stop(epoch: int, _: float) -> None:
        if epoch == done:
            raise Killed

    with pytest.raises(Killed):
        train(dataset, tmp_path / "run", on_epoch=stop, board=tmp_path / "board")
    assert {len(values) for values in scalars(tmp_path / "board").values()} == {done}, "they can be seen meanwhile"
    for events in (tmp_path / "board").iterdir():
        events.write_bytes(events.read_bytes()[:-20])
    assert_same(train(dataset, tmp_path / "run", board=tmp_path / "board"), undisturbed)
    assert_shown(scalars(tmp_path / "board"), quartiles(pd.read_csv(undisturbed / "validation.csv")))


def test_tensorboard_sees_each_trial(dataset: Path, trials: Path, tmp_path: Path) -> None:
    """Their own rows of the table."""
    pytest.importorskip("tensorboard")
    train(dataset, tmp_path / "run", 3 * (4, 5), TRIALS, board=tmp_path / "board")
    expected = {}
    for trial, rows in pd.read_csv(trials / "validation.csv").groupby("trial"):
        expected |= {f"trial_{trial}/{tag}": values for tag, values in quartiles(rows).items()}
    assert_shown(scalars(tmp_path / "board"), expected)


def test_a_job_of_a_cluster_is_a_training_like_any_other(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a job of SLURM, Lightning would look for other processes, and requeue the job itself."""
    cluster = {"SLURM_JOB_ID": "7", "SLURM_NTASKS": "2", "SLURM_PROCID": "1", "SLURM_NODEID": "0", "SLURM_LOCALID": "1"}
    for name, value in cluster.items():
        monkeypatch.setenv(name, value)
    assert_same(train(dataset, tmp_path), undisturbed)


def test_a_kill_while_the_results_are_written_costs_nothing(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Weights are there, the table is not: the next run writes both."""

    def stop(module: TrainingModule) -> pd.DataFrame:
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("affmap.training.fit.losses", stop)
        with pytest.raises(Killed):
            train(dataset, tmp_path)
    epochs: list[int] = []
    train(dataset, tmp_path, on_epoch=lambda epoch, _: epochs.append(epoch))
    assert epochs == []
    assert_same(tmp_path, undisturbed)


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), SystemExit(143)])
def test_a_signal_ends_a_training_with_a_checkpoint(
    dataset: Path, undisturbed: Path, tmp_path: Path, ending: BaseException
) -> None:
    """Lightning makes an exit of Ctrl-C and listens no more: it comes out as it went in. No half-trained weights look
    finished, and what was done until then is not done again."""

    def end(epoch: int, _: float) -> None:
        if epoch == 2:
            raise ending

    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(type(ending)):
        train(dataset, tmp_path, on_epoch=end)
    assert signal.getsignal(signal.SIGINT) == handler
    assert not (tmp_path / "weights.safetensors").exists() and not (tmp_path / "validation.csv").exists()
    epochs: list[int] = []
    train(dataset, tmp_path, on_epoch=lambda epoch, _: epochs.append(epoch))
    assert epochs == [3, 4]
    assert_same(tmp_path, undisturbed)


def test_each_epoch_asks_for_its_own_order(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Epochs 0, 1, 2, ... as Lightning asks; a training that is resumed goes on with the next."""
    asked: list[int] = []

    def note(seed: int, name: str, epoch: int) -> np.random.Generator:
        asked.append(epoch)
        return generator(seed, name, epoch)

    def stop(epoch: int, _: float) -> None:
        if epoch == 2:
            raise Killed

    monkeypatch.setattr("affmap.data.batches.generator", note)
    with pytest.raises(Killed):
        train(dataset, tmp_path, (0,), on_epoch=stop)
    assert asked == [0, 1]
    asked.clear()
    train(dataset, tmp_path, (0,))
    assert asked[-2:] == [2, 3]  # before, it asks once for what the checkpoint says


def test_nothing_is_written_elsewhere_and_nobody_is_warned(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The working folder stays empty, and so does the terminal; also on a machine of many cores, where Lightning
    would advise more helpers."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(16)), raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 16)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        train(dataset, tmp_path / "run", (0,), SETTINGS.model_copy(update={"num_epochs": 1}))
    assert not [str(warning.message) for warning in warned]
    assert not list((tmp_path / "elsewhere").iterdir())
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""


def test_training_does_not_depend_on_global_randomness(dataset: Path, undisturbed: Path, tmp_path: Path) -> None:
    """Undisturbed training, bit by bit, after other seeds were set."""
    torch.manual_seed(123)
    np.random.seed(123)
    assert_same(train(dataset, tmp_path), undisturbed)


def test_saved_weights_come_back(tmp_path: Path) -> None:
    """Bit by bit, into a stack of other seeds; a stack of another shape refuses them."""
    original = stack((1, 2))
    save(copy(original), tmp_path / "weights.safetensors")
    other = restore(stack((8, 9)), tmp_path / "weights.safetensors")
    assert not other.training
    for name, weight in original.state_dict().items():
        assert torch.equal(other.state_dict()[name], weight), name
    for wrong in (stack((1, 2, 3)), stack((1, 2), context_size=5), stack((1, 2), context_size=0)):
        with pytest.raises(ConfigError, match=r"(size mismatch|Unexpected key)"):
            restore(wrong, tmp_path / "weights.safetensors")


def test_a_checkpoint_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As traced; only then is the one before it removed."""
    trace = Trace(monkeypatch)
    for content in (b"first", b"second"):
        keep(tmp_path, lambda path, content=content: path.write_bytes(content))
        assert trace.renamed[-1] == last(tmp_path) and trace.is_flushed(tmp_path)
