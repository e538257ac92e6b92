"""Training of recurrent models: `torch.nn.GRU` in a plain loop, the member alone, itself undisturbed."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from torch import Tensor
from torch.distributions import Normal

from affmap.data.batches import Batch, DataModule, read
from affmap.data.collect import Exploration, collect
from affmap.env import Layout, Vehicle
from affmap.model.gru import GRU
from affmap.model.registry import GRUSettings
from affmap.model.stack import ModelSettings, Stack
from affmap.model.weights import restore
from affmap.model.windows import take_apart
from affmap.random import generator
from affmap.training import loops
from affmap.training.fit import fit
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings
from affmap.training.steps import step_losses

EXPLORATION = Exploration.load("data", "default", num_sequences=8, num_validation=3, num_steps=24)
SETTINGS = TrainingSettings.load("training", "default", num_epochs=3, batch_size=2, chunk_length=10)
BATCHES_PER_EPOCH = 9  # batches of 2, 2 and 1 sequences, chunks of 10, 10 and 4 steps
SEEDS = (4, 5, 6)


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


def stack(seeds: tuple[int, ...] = SEEDS, context_size: int = 3) -> Stack:
    gru = GRUSettings(kind="gru")
    return Stack(ModelSettings.load("model", "default", context_size=context_size, transition=gru), 1, seeds)


def batches(dataset: Path) -> DataModule:
    return DataModule(dataset, EXPLORATION, SETTINGS.batch_size, SETTINGS.chunk_length)


def train(dataset: Path, folder: Path, seeds: tuple[int, ...] = SEEDS) -> Path:
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    fit(stack(seeds), batches(dataset), SETTINGS, folder, folder / "checkpoints")
    return folder


@pytest.fixture(scope="module")
def undisturbed(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train(dataset, tmp_path_factory.mktemp("undisturbed"))


class Alone(torch.nn.Module):
    """PyTorch's own recurrent unit and linear layer, with the weights of a stack of one; the state is kept."""

    def __init__(self, gru: GRU, context_size: int) -> None:
        super().__init__()
        self.unit = torch.nn.GRU(6 + context_size, 32, batch_first=True)
        self.linear = torch.nn.Linear(32, 4)
        weights = [gru.input_weight.mT, gru.hidden_weight.mT, gru.input_bias, gru.hidden_bias]
        weights += [gru.output.weight.mT, gru.output.bias]
        for parameter, weight in zip(self.parameters(), weights, strict=True):
            parameter.data = weight[0].detach().clone()
        self.state: Tensor | None = None

    def forward(self, code: Tensor, delta: Tensor, action: Tensor) -> Normal:
        states, state = self.unit(torch.cat([4 * delta, action, code], dim=-1), self.state)
        self.state = state.detach()
        mean, log_std = self.linear(states).chunk(2, dim=-1)
        return Normal(mean / 4, log_std.exp() / 4)


def test_training_is_a_plain_loop_around_pytorchs_own_unit(dataset: Path, undisturbed: Path) -> None:
    """Appendix A for one member: errors go back through a chunk, the hidden state goes on to the next chunk, and begins
    anew with the next sequences; two Adams, clipping."""
    model, data = stack((5,)), read(dataset)
    assert model.vision is not None and isinstance(model.transition, GRU)
    transition = Alone(model.transition, 3)
    parts = [(transition, 0.008, 1.2), (model.vision, 0.00075, 2.0)]
    adams = [torch.optim.Adam(part.parameters(), lr, (0.9, 0.999), 1e-4) for part, lr, _ in parts]
    training_nll, validation_nll = [], []

    def loss(sequences: list[int], start: int, end: int) -> Tensor:
        cut = (slice(None), sequences, slice(start, end))
        density = transition(model.encode(data.views.select(cut))[0], data.delta[cut][0], data.action[cut][0])
        return -density.log_prob(data.target[cut][0]).sum(-1).mean()

    for epoch in range(3):
        order, losses = generator(0, "batch order", epoch).permutation(5).tolist(), []
        for first in (0, 2, 4):
            transition.state = None
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
            transition.state = None
            validation_nll.append(loss([5, 6, 7], 0, 24).item())
    table = pd.read_csv(undisturbed / "validation.csv").query("member == 5")
    np.testing.assert_allclose(table["training_nll"], training_nll, atol=1e-3)
    np.testing.assert_allclose(table["validation_nll"], validation_nll, atol=1e-3)
    assert np.ptp(validation_nll) > 0.1
    trained = restore(stack(), undisturbed / "weights.safetensors").transition
    assert isinstance(trained, GRU)
    torch.testing.assert_close(trained.hidden_weight[1].mT, transition.unit.weight_hh_l0, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(trained.output.weight[1].mT, transition.linear.weight, rtol=1e-3, atol=1e-4)


def test_a_member_trained_in_a_stack_is_the_seed_trained_alone(
    dataset: Path, undisturbed: Path, tmp_path: Path
) -> None:
    """To float rounding: matrices of other sizes are summed in another order."""
    alone = train(dataset, tmp_path, (6,))
    whole = restore(stack(), undisturbed / "weights.safetensors").state_dict()
    for name, weight in restore(stack((6,)), alone / "weights.safetensors").state_dict().items():
        torch.testing.assert_close(whole[name][2:], weight, rtol=1e-3, atol=1e-4, msg=name)
    together, single = (pd.read_csv(folder / "validation.csv") for folder in (undisturbed, alone))
    np.testing.assert_allclose(single.to_numpy(), together.query("member == 6").to_numpy(), atol=1e-3)


class Killed(Exception):  # noqa: N818
    """Stands for a power cut."""


def test_a_training_killed_in_the_middle_gives_what_it_would_have(
    dataset: Path, undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Undisturbed training, byte by byte; killed in the middle of the second epoch, in the second chunk of a batch."""
    counter, update = iter(range(BATCHES_PER_EPOCH + 4)), TrainingModule.update

    def stop(self: TrainingModule, *arguments: object) -> Tensor:
        if next(counter, None) is None:
            raise Killed
        return update(self, *arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(TrainingModule, "update", stop)
        with pytest.raises(Killed):
            train(dataset, tmp_path)
    assert len(list(tmp_path.glob("checkpoints/*.ckpt"))) == 1
    train(dataset, tmp_path)
    for path in undisturbed.iterdir():
        if path.is_file():
            assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


def batch(is_first: bool, seed: int) -> Batch:
    """Two sequences of six steps, whose motion requires a gradient."""
    draw = torch.Generator().manual_seed(seed)
    views = torch.rand(1, 2, 6, 1, 11, 11, generator=draw) < 0.3
    delta, target = (0.1 * torch.randn(1, 2, 6, 2, generator=draw) for _ in range(2))
    return Batch(
        take_apart(views), delta.requires_grad_(), torch.rand(1, 2, 6, 4, generator=draw), target, is_first=is_first
    )


def test_errors_go_back_through_a_chunk_and_stop_at_the_carry() -> None:
    """The last step's prediction depends on the first input of its chunk; its gradient does not go on to the chunk
    before, though the state does."""
    module = TrainingModule(stack(), SETTINGS)
    first, second = batch(True, 0), batch(False, 1)
    assert not loops.usable(module.stack)
    transition, code = module.stack.transition, module.stack.encode(first.views)
    _, prediction = transition.unroll(transition.initial(2), code, first.delta, first.action)
    (gradient,) = torch.autograd.grad(prediction.mean[:, :, -1].sum(), first.delta)
    assert (gradient.abs().amax((0, 3)) > 0).all()  # [B, T]
    module.loss(first)
    after = module.loss(second)
    (other, own) = torch.autograd.grad(after.sum(), [first.delta, second.delta], allow_unused=True)
    assert other is None and own is not None and (own.abs().amax((0, 3)) > 0).all()
    anew = module.loss(second._replace(is_first=True))
    assert (after - anew).abs().min() > 1e-6


def test_losses_of_steps_are_those_of_the_validation(dataset: Path, undisturbed: Path) -> None:
    """Their mean, with the state handed from chunk to chunk, is the loss in the table."""
    trained = restore(stack(), undisturbed / "weights.safetensors")
    losses = step_losses(trained, batches(dataset).val_dataloader())
    assert losses.shape == (3, 3, 24)
    table = pd.read_csv(undisturbed / "validation.csv").query("epoch == 3")
    np.testing.assert_allclose(losses.mean((1, 2)), table["validation_nll"], atol=2e-5)
