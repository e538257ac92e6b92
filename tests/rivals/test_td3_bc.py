"""TD3 with behaviour cloning, against one update of one member with PyTorch's own layers."""

import copy
import io
from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from affmap.rivals.policy import CHANGE
from affmap.rivals.settings import TD3BC
from affmap.rivals.td3_bc import Offline, Transitions

RNG = np.random.default_rng(0)
DATA = {
    "position": RNG.uniform(0, 2, (3, 9, 2)).astype(np.float32),
    "view": RNG.integers(2, size=(3, 8, 1, 11, 11)).astype(bool),
    "action": RNG.uniform(size=(3, 8, 4)).astype(np.float32),
}
SMALL = TD3BC.load("rival", "td3_bc", hidden_sizes=[6, 5], rounds=2, updates=3, batch_size=8, max_delay=4)


def plain(layers: nn.ModuleList, member: int) -> nn.Sequential:
    """A member's layers as PyTorch has them."""
    parts: list[nn.Module] = []
    for layer in layers:
        own = nn.Linear(*layer.weight[member].shape)
        with torch.no_grad():
            own.weight.copy_(layer.weight[member].T)
            own.bias.copy_(layer.bias[member])
        parts += [own, nn.ReLU()]
    return nn.Sequential(*parts[:-1])


class ByHand:
    """One member with the published rules, without anything from the package but its weights at the beginning."""

    def __init__(self, learner: Offline, member: int) -> None:
        self.policy = nn.Sequential(*plain(learner.network.layers, member), nn.Tanh())
        self.critics = [plain(critic.layers, member) for critic in learner._critics]  # type: ignore[union-attr, arg-type]
        self.old_policy, self.old_critics = copy.deepcopy(self.policy), copy.deepcopy(self.critics)
        self.policy_steps = torch.optim.Adam(self.policy.parameters(), lr=SMALL.learning_rate)
        self.critic_steps = torch.optim.Adam(
            [p for each in self.critics for p in each.parameters()], SMALL.learning_rate
        )

    def update(self, drawn: Transitions, has_policy: bool) -> None:
        state, pixels, action, reward, next_state, next_pixels, noise = drawn
        now, then = torch.cat([state, pixels], 1), torch.cat([next_state, next_pixels], 1)
        with torch.no_grad():
            next_action = (self.old_policy(then) + noise).clamp(-1, 1)
            one, two = (critic(torch.cat([then, next_action], 1))[:, 0] for critic in self.old_critics)
            aim = 0.01 * reward + 0.99 * torch.where(one < two, one, two)
        loss = sum(nn.functional.mse_loss(each(torch.cat([now, action], 1))[:, 0], aim) for each in self.critics)
        assert isinstance(loss, Tensor)
        self.critic_steps.zero_grad()
        loss.backward()
        self.critic_steps.step()
        if has_policy:
            chosen = self.policy(now)
            value = self.critics[0](torch.cat([now, chosen], 1))
            weight = SMALL.weight / value.abs().mean().detach()
            self.policy_steps.zero_grad()
            (nn.functional.mse_loss(chosen, action) - weight * value.mean()).backward()
            self.policy_steps.step()
            pairs = [(self.old_policy, self.policy), *zip(self.old_critics, self.critics, strict=True)]
            for old, new in pairs:
                for target, source in zip(old.parameters(), new.parameters(), strict=True):
                    target.data.mul_(0.995).add_(0.005 * source.data)


def same(layers: nn.ModuleList, member: int, expected: nn.Sequential) -> None:
    for layer, own in zip(layers, [each for each in expected if isinstance(each, nn.Linear)], strict=True):
        torch.testing.assert_close(layer.weight[member], own.weight.T)
        torch.testing.assert_close(layer.bias[member], own.bias)


def test_updates_are_the_published_ones() -> None:
    """Three updates of the second of two members: with the policy, without it, and with it again."""
    learner, rng = Offline(SMALL, [3, 4], DATA), np.random.default_rng(2)
    expected, before = ByHand(learner, 1), copy.deepcopy(learner.network)
    for has_policy in (True, False, True):
        drawn = Transitions(*map(torch.stack, zip(*(learner.draw(16, rng) for _ in range(2)), strict=True)))
        learner.update(drawn, has_policy)
        expected.update(Transitions(*(part[1] for part in drawn)), has_policy)
        same(learner.network.layers, 1, expected.policy)
        policy, critics = learner._targets
        same(policy.layers, 1, expected.old_policy)  # type: ignore[arg-type]
        for number in range(2):
            same(learner._critics[number].layers, 1, expected.critics[number])  # type: ignore[arg-type]
            same(critics[number].layers, 1, expected.old_critics[number])  # type: ignore[index]
    assert not torch.equal(before.layers[0].weight, learner.network.layers[0].weight)


def test_a_round_has_every_second_update_with_the_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three updates with eight steps of each member."""
    found = []
    monkeypatch.setattr(
        Offline, "update", lambda self, drawn, has_policy: found.append((*drawn.reward.shape, has_policy))
    )
    Offline(SMALL, [3, 4], DATA).round()
    assert found == [(2, 8, True), (2, 8, False), (2, 8, True)]


def known() -> Mapping[tuple[float, ...], tuple[np.ndarray, ...]]:
    """State -> the rest of a transition, by a loop over all steps that have a next one, and all delays."""
    found = {}
    for sequence in range(3):
        position, view, action = (DATA[key][sequence] for key in ("position", "view", "action"))

        def state(step: int, goal: np.ndarray, position: np.ndarray = position) -> np.ndarray:
            delta = position[step] - position[max(step - 1, 0)]
            return np.concatenate([position[step], CHANGE * delta, goal - position[step]])

        for step in range(7):
            for later in range(step + 1, min(step + 4, 8) + 1):
                goal = position[later]
                rest = -np.linalg.norm(position[step + 1] - goal), state(step + 1, goal)
                found[tuple(state(step, goal).round(4))] = (2 * action[step] - 1, *rest, view[step], view[step + 1])
    return found


def test_transitions_are_those_of_the_data() -> None:
    """Every one is drawn; a reward is minus the distance that remains, and noise is cut."""
    drawn, expected = Offline(SMALL, [0], DATA).draw(3000, np.random.default_rng(1)), known()
    keys = [tuple(state.round(4)) for state in drawn.state.numpy()]
    assert {*keys} == {*expected}
    for row, key in enumerate(keys):
        action, reward, state, view, next_view = expected[key]
        np.testing.assert_allclose(drawn.action[row], action, atol=1e-6)
        np.testing.assert_allclose(drawn.reward[row], reward, atol=1e-6)
        np.testing.assert_allclose(drawn.next_state[row], state, atol=1e-5)
        np.testing.assert_array_equal(drawn.pixels[row], view.ravel())
        np.testing.assert_array_equal(drawn.next_pixels[row], next_view.ravel())
    assert drawn.noise.abs().max() == 0.5 and 0.17 < drawn.noise.std() < 0.21


def test_a_member_learns_as_it_would_alone() -> None:
    """Two members, and each by itself."""
    both = Offline(SMALL, [4, 7], DATA)
    alone = [Offline(SMALL, [seed], DATA) for seed in (4, 7)]
    for each in (both, *alone):
        each.round()
        each.round()
    for member, own in enumerate(alone):
        for one, other in zip(both._learned.parameters(), own._learned.parameters(), strict=True):
            torch.testing.assert_close(one[member], other[0])
    first, second = (critic.layers[0].weight for critic in both._critics)  # type: ignore[union-attr, index]
    assert not torch.equal(first, second)


def test_it_goes_on_from_a_checkpoint_as_if_nothing_had_happened() -> None:
    """Two rounds without interruption; the checkpoint is read without unpickling."""
    undisturbed, stopped, resumed = (Offline(SMALL, [1, 2], DATA) for _ in range(3))
    for each in (undisturbed, stopped):
        each.round()
    file = io.BytesIO()
    torch.save(stopped.state(), file)
    file.seek(0)
    resumed.load(torch.load(file, weights_only=True))
    for each in (undisturbed, resumed):
        each.round()
    assert resumed.num_rounds == resumed.total == 2
    for part in ("_learned", "_targets"):
        assert all(map(torch.equal, getattr(undisturbed, part).parameters(), getattr(resumed, part).parameters()))


def test_a_policy_flies_to_goals_although_the_data_do_not() -> None:
    """In a world where each throttle moves one way, random steps teach it; the actions of the data are chance."""
    rng = np.random.default_rng(0)
    action = rng.uniform(size=(60, 20, 4)).astype(np.float32)
    moves = 0.4 * (action[..., :2] - action[..., 2:])
    position = np.concatenate([np.zeros((60, 1, 2)), moves.cumsum(1)], axis=1).astype(np.float32)
    data = {"position": position, "view": np.zeros((60, 20, 1, 11, 11), bool), "action": action}
    changes = {
        "hidden_sizes": [16],
        "rounds": 1,
        "updates": 1500,
        "batch_size": 32,
        "learning_rate": 0.005,
        "max_delay": 8,
    }
    learner = Offline(TD3BC.load("rival", "td3_bc", **changes), [0], data)
    learner.round()
    drawn = learner.draw(500, np.random.default_rng(1))
    with torch.no_grad():
        output = learner.network(drawn.state[None], drawn.pixels[None])[0]
    way, push = drawn.state[:, 4:], output[:, :2] - output[:, 2:]
    far = way.abs() > 0.3
    assert ((way > 0) == (push > 0))[far].float().mean() > 0.9
