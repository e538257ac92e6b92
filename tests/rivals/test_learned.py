"""PPO and SAC by Stable-Baselines3."""

import numpy as np
import pytest
import torch

from affmap.control.controller import Observation
from affmap.env.body import Vehicle
from affmap.env.layout import Layout
from affmap.rivals.learned import Reinforced
from affmap.rivals.policy import Policy, pixels_of, state_of
from affmap.rivals.settings import PPO, SAC, Reinforcement

VEHICLE = Vehicle.load("vehicle", "default")
SMALL = PPO.load("rival", "ppo", hidden_sizes=[5, 4], steps=2048, num_vehicles=4, num_steps=20)
SAC_SMALL = SAC.load("rival", "sac", hidden_sizes=[5, 4], steps=160, num_vehicles=4, num_steps=20)
COMMON = ("batch_size", "gamma", "ent_coef", "learning_rate")
DEFAULTS = {
    "PPO": (*COMMON, "n_epochs", "gae_lambda", "vf_coef", "max_grad_norm"),
    "SAC": (*COMMON, "tau", "learning_starts", "train_freq", "target_entropy", "target_update_interval"),
}
"""Values of the libraries that ours keep."""


def seen(number: int) -> Observation:
    rng = np.random.default_rng(0)
    parts = {key: rng.normal(size=(number, 2)) for key in ("position", "delta", "goal")}
    views = rng.integers(2, size=(number, 1, 11, 11))
    return Observation.of(
        [{key: part[row] for key, part in parts.items()} | {"view": views[row]} for row in range(number)]
    )


@pytest.mark.parametrize("own", [SMALL, SAC_SMALL], ids=["PPO", "SAC"])
def test_a_policy_acts_as_its_library_says(world: Layout, monkeypatch: pytest.MonkeyPatch, own: Reinforcement) -> None:
    """The library's own `predict`, and its defaults in all else."""
    library = pytest.importorskip("stable_baselines3")
    name = own.kind.upper()  # type: ignore[attr-defined]
    algorithm, learners = getattr(library, name), []

    class Kept(algorithm):  # type: ignore[misc, valid-type]
        def __init__(self, *arguments: object, **options: object) -> None:
            super().__init__(*arguments, **options)
            learners.append(self)

    monkeypatch.setattr(library, name, Kept)
    learned, observation = Reinforced(own, [3, 4], [world], VEHICLE), seen(6)
    learned.round()
    learned.round()
    assert learned.num_rounds == learned.total == 2
    decision, _ = Policy(learned.network).act(observation, None, [])
    inputs = torch.cat([state_of(observation), pixels_of(observation)], dim=1).numpy()
    for member, learner in enumerate(learners):
        mine = slice(3 * member, 3 * member + 3)
        actions, _ = learner.predict(inputs[mine], deterministic=True)
        np.testing.assert_allclose(decision.action[mine], ((actions + 1) / 2).clip(0, 1), atol=1e-5)
    default = algorithm("MlpPolicy", learners[0].get_env())
    for key in DEFAULTS[name]:
        assert getattr(learners[0], key) == getattr(default, key), key
    assert learners[0].policy.activation_fn is default.policy.activation_fn
    if name == "PPO":
        assert learners[0].n_steps * 4 == default.n_steps
    else:
        assert learners[0].replay_buffer.full
        assert learners[0]._n_updates == own.steps - default.learning_starts


def test_a_member_is_the_same_alone_and_the_next_one_another(world: Layout) -> None:
    """Trained twice, as the second of two and by itself."""
    pytest.importorskip("stable_baselines3")
    both, alone = Reinforced(SMALL, [3, 4], [world], VEHICLE), Reinforced(SMALL, [4], [world], VEHICLE)
    for each in (both, both, alone):
        each.round()
    for one, other in zip(both.network.parameters(), alone.network.parameters(), strict=True):
        assert torch.equal(one[1], other[0]) and not torch.equal(one[0], other[0])


def test_it_goes_on_with_the_next_member(world: Layout) -> None:
    """From a state without training: the weights that were there."""
    first, resumed = (Reinforced(SMALL, [3, 4], [world], VEHICLE) for _ in range(2))
    first.network.layers[0].weight[0] = 1.0
    first.num_rounds = 1
    resumed.load(first.state())
    assert resumed.num_rounds == 1 and (resumed.network.layers[0].weight[0] == 1).all()
