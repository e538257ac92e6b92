"""Compiled updates of a stack: PyTorch's autograd, clipping and Adam to rounding, and what they leave to PyTorch."""

from collections.abc import Iterator
from typing import Any

import pytest
import torch

from affmap import compiled
from affmap.data.batches import Batch
from affmap.model.stack import ModelSettings, Stack
from affmap.model.transition import MLP
from affmap.model.windows import take_apart
from affmap.training import loops
from affmap.training.module import TrainingModule
from affmap.training.settings import TrainingSettings

pytest.importorskip("numba")

CONTEXT_SIZES = (0, 1, 3, 5, 8, 16, 32)


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    yield
    compiled.use(True)


def module(
    context_size: int = 3,
    channels: int = 1,
    seeds: tuple[int, ...] = (0, 1, 2),
    hidden_size: int = 32,
    transition: type[MLP] = MLP,
    **changes: Any,
) -> TrainingModule:
    settings = ModelSettings.load("model", "default", context_size=context_size, hidden_size=hidden_size)
    stack = Stack(settings, channels, seeds, transition)
    return TrainingModule(stack, TrainingSettings.load("training", "default", **changes))


def batch(channels: int = 1, seed: int = 0, shape: tuple[int, int] = (4, 7), distinct: int = 9) -> Batch:
    """Sequences and steps with some distinct views, of which some are seen often and one is blank."""
    generator = torch.Generator().manual_seed(seed)
    views = torch.rand(distinct, channels, 11, 11, generator=generator) < 0.1
    views[0] = False
    ids = torch.randint(distinct, (1, *shape), generator=generator)
    delta, target = (0.1 * torch.randn(1, *shape, 2, generator=generator) for _ in range(2))
    return Batch(take_apart(views[ids]), delta, torch.rand(1, *shape, 4, generator=generator), target, is_first=True)


def updated(trained: TrainingModule, batches: list[Batch], by_loops: bool) -> tuple[list[torch.Tensor], Any]:
    """Losses before each update, and the state of the optimiser."""
    compiled.use(by_loops)
    assert loops.usable(trained.stack) == by_loops
    optimizer = trained.configure_optimizers()
    losses = [trained.update(each, optimizer) for each in batches]
    return losses, optimizer.state_dict()["state"]


def assert_close(found: torch.Tensor, expected: torch.Tensor, name: str) -> None:
    """To rounding of the largest of the numbers."""
    atol = 2e-5 * expected.abs().max().item()
    torch.testing.assert_close(found, expected, rtol=0, atol=atol, msg=lambda message: f"{name}: {message}")


@pytest.mark.parametrize("channels", [1, 4])
@pytest.mark.parametrize("context_size", CONTEXT_SIZES)
@pytest.mark.parametrize("max_norm", [1e6, 1e-3])
def test_an_update_is_pytorchs(context_size: int, channels: int, max_norm: float) -> None:
    """Losses, gradients of all parameters (ten times Adam's first mean) and their squares beside autograd and
    `clip_per_member`, with and without clipping; weights by Adam's rule, written out."""
    changes = {"vision_max_norm": max_norm, "transition_max_norm": 2 * max_norm}
    ours, theirs = (module(context_size, channels, **changes) for _ in range(2))
    data = batch(channels)
    (loss,), state = updated(ours, [data], by_loops=True)
    (expected_loss,), expected_state = updated(theirs, [data], by_loops=False)
    torch.testing.assert_close(loss, expected_loss)
    assert state.keys() == expected_state.keys()
    start = module(context_size, channels).stack
    for number, (name, weight) in enumerate(ours.stack.named_parameters()):
        mean, square = state[number]["exp_avg"] / 0.1, state[number]["exp_avg_sq"] / 0.001
        rate = 0.008 if name.startswith("transition") else 0.00075
        torch.testing.assert_close(weight, start.get_parameter(name) - rate * mean / (square.sqrt() + 1e-4), msg=name)
        torch.testing.assert_close(weight, theirs.stack.get_parameter(name), rtol=1e-4, atol=1e-4, msg=name)
        assert state[number]["step"] == expected_state[number]["step"] == 1
        for moment in ("exp_avg", "exp_avg_sq"):
            assert expected_state[number][moment].abs().max() > 0
            assert_close(state[number][moment], expected_state[number][moment], f"{moment} of {name}")


@pytest.mark.parametrize(
    ("shape", "distinct", "hidden_size"), [((1, 1), 1, 32), ((3, 5), 40, 7), ((2, 8), 8, 8), ((5, 33), 3, 50)]
)
def test_sizes_need_not_be_eights(shape: tuple[int, int], distinct: int, hidden_size: int) -> None:
    """Samples, views and hidden units of other numbers; several updates, with batches of several sizes, by PyTorch."""
    ours, theirs = (module(3, 2, (4, 5), hidden_size) for _ in range(2))
    data = [batch(2, 0, shape, distinct), batch(2, 1), batch(2, 2, shape, distinct)]
    for loss, expected in zip(updated(ours, data, True)[0], updated(theirs, data, False)[0], strict=True):
        torch.testing.assert_close(loss, expected, rtol=1e-4, atol=1e-4)
    for name, weight in ours.stack.named_parameters():
        torch.testing.assert_close(weight, theirs.stack.get_parameter(name), rtol=1e-3, atol=1e-3, msg=name)


def test_trials_have_their_own_norms_and_rates() -> None:
    """`TrainingModule` in PyTorch over three updates."""
    changes: dict[str, Any] = {
        "vision_lr": [0.003, 0.0001],
        "transition_max_norm": [1e-3, 9],
        "vision_max_norm": [9, 0.1],
    }
    ours, theirs = (module(3, 1, (0, 1, 0, 1), **changes) for _ in range(2))
    data = [batch(seed=seed) for seed in range(3)]
    updated(ours, data, by_loops=True)
    updated(theirs, data, by_loops=False)
    for name, weight in ours.stack.named_parameters():
        torch.testing.assert_close(weight, theirs.stack.get_parameter(name), rtol=1e-4, atol=1e-5, msg=name)


@pytest.mark.parametrize("context_size", [0, 3])
def test_losses_without_a_gradient_are_those_of_pytorch(context_size: int) -> None:
    """`TrainingModule.loss`; weights stay as they are."""
    trained, data = module(context_size), batch()
    before = [weight.clone() for weight in trained.stack.parameters()]
    torch.testing.assert_close(loops.losses(trained.stack, data), trained.loss(data).detach())
    assert all(torch.equal(*pair) for pair in zip(before, trained.stack.parameters(), strict=True))


def test_a_member_in_a_stack_is_the_member_alone() -> None:
    """Bit by bit, after some updates."""
    data = [batch(seed=seed) for seed in range(4)]
    together = module(seeds=(4, 5, 6))
    losses, _ = updated(together, data, by_loops=True)
    for member, seed in enumerate((4, 5, 6)):
        alone = module(seeds=(seed,))
        own, _ = updated(alone, data, by_loops=True)
        assert torch.equal(torch.cat(own), torch.stack(losses)[:, member])
        for name, weight in alone.stack.named_parameters():
            assert torch.equal(weight[0], together.stack.get_parameter(name)[member]), name


def test_a_lost_member_takes_no_other_with_it() -> None:
    """NaN in a weight of one: all of its weights are lost, those of the others are as without it, bit by bit."""
    broken, whole = module(), module()
    with torch.no_grad():
        broken.stack.transition.hidden_weight[1, 0, 0] = torch.nan
    for trained in (broken, whole):
        updated(trained, [batch(), batch(seed=1)], by_loops=True)
    for name, weight in broken.stack.named_parameters():
        assert weight[1].isnan().all(), name
        assert torch.equal(weight[[0, 2]], whole.stack.get_parameter(name)[[0, 2]]), name


def test_pytorch_goes_on_where_compiled_updates_stopped_and_the_other_way_round() -> None:
    """The optimiser's state is the same: two updates of each, in both orders, beside four of PyTorch's."""
    data = [batch(seed=seed) for seed in range(4)]
    expected = module()
    updated(expected, data, by_loops=False)
    for order in ((True, True, False, False), (False, False, True, True)):
        mixed = module()
        optimizer = mixed.configure_optimizers()
        for each, by_loops in zip(data, order, strict=True):
            compiled.use(by_loops)
            mixed.update(each, optimizer)
        for name, weight in mixed.stack.named_parameters():
            torch.testing.assert_close(weight, expected.stack.get_parameter(name), rtol=1e-4, atol=1e-5, msg=name)


class Other(MLP):
    """A transition model of somebody's own."""


def test_what_is_not_the_papers_model_is_left_to_pytorch() -> None:
    """A subclass of the transition model; a stack in double precision; loops that are switched off."""
    assert loops.usable(module().stack)
    assert not loops.usable(module(transition=Other).stack)
    assert not loops.usable(module().stack.double())
    compiled.use(False)
    assert not loops.usable(module().stack)
