"""Reinforcement learning by Stable-Baselines3 (extra `rl`), of one member after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.model.layers import StackedLinear
from affmap.random import integer
from affmap.rivals.flights import Flights
from affmap.rivals.policy import Network
from affmap.rivals.settings import PPO, ROLLOUT, Reinforcement


class Reinforced:
    """M policies that learn from flights of their own, by PPO or SAC; a round is the whole training of a member.

    A training that is interrupted begins anew with the member that it was at: Box2D's worlds cannot be stored.

    Attributes:
        network: the policies; those that are not yet trained have 0 everywhere.
        num_rounds: members that are trained.
    """

    def __init__(
        self, settings: Reinforcement, seeds: Sequence[int], layouts: Sequence[Layout], vehicle: Vehicle
    ) -> None:
        """Take the layouts of the flights."""
        self._settings, self._seeds, self._layouts, self._vehicle = settings, seeds, layouts, vehicle
        generators = [torch.Generator().manual_seed(0) for _ in seeds]
        self.network = Network.of(settings, generators, len(layouts[0].channels))
        self.network.requires_grad_(False)
        for each in self.network.parameters():
            each.zero_()
        self.num_rounds = 0

    @property
    def total(self) -> int:
        """Number of members."""
        return len(self._seeds)

    def round(self) -> None:
        """Train the next member."""
        learned = train(self._settings, self._seeds[self.num_rounds], self._layouts, self._vehicle)
        for layer, own in zip(self.network.layers, learned, strict=True):
            assert isinstance(layer, StackedLinear)
            layer.weight[self.num_rounds], layer.bias[self.num_rounds] = own.weight.detach().T, own.bias.detach()
        self.num_rounds += 1

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later, as tensors."""
        return {"network": self.network.state_dict(), "num_rounds": self.num_rounds}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from an earlier state."""
        self.network.load_state_dict(state["network"])
        self.num_rounds = state["num_rounds"]


def train(settings: Reinforcement, seed: int, layouts: Sequence[Layout], vehicle: Vehicle) -> list[torch.nn.Linear]:
    """Train a policy; returns its layers. Its action is the mean, as in evaluations of Stable-Baselines3."""
    import stable_baselines3 as library
    from stable_baselines3.common.vec_env import DummyVecEnv

    vehicles = DummyVecEnv([lambda: Flights(layouts, vehicle, settings.num_steps)] * settings.num_vehicles)
    options: dict[str, Any] = {
        "batch_size": settings.batch_size,
        "policy_kwargs": {"net_arch": list(settings.hidden_sizes)},
        "seed": integer(seed, "reinforcement learning"),
        "device": "cpu",
    }
    if isinstance(settings, PPO):
        ppo = library.PPO("MlpPolicy", vehicles, n_steps=ROLLOUT // settings.num_vehicles, **options)
        policy = ppo.learn(settings.steps).policy
        parts: tuple[torch.nn.Module, ...] = policy.mlp_extractor.policy_net, policy.action_net
    else:  # an update for each step of each vehicle; of a buffer of a million, as by default, most would stay empty
        sac = library.SAC("MlpPolicy", vehicles, gradient_steps=-1, buffer_size=settings.steps, **options)
        actor = sac.learn(settings.steps).actor
        parts = actor.latent_pi, actor.mu
    return [layer for part in parts for layer in part.modules() if isinstance(layer, torch.nn.Linear)]
