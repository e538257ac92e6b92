"""Settings of rivals."""

import pytest

from affmap.rivals.settings import PPO, SAC, TD3BC, Cloning, Distillation, Rival

KINDS: dict[str, type[Rival]] = {
    "cloning": Cloning, "distilled": Distillation, "td3_bc": TD3BC, "ppo": PPO, "ppo_million": PPO, "sac": SAC
}  # fmt: skip
ALL = [kind.load("rival", name) for name, kind in KINDS.items()]


@pytest.mark.parametrize("rival", ALL, ids=[rival.name for rival in ALL])
def test_a_share_of_the_effort_changes_nothing_else(rival: Rival) -> None:
    """A tenth of the updates, flights or steps, rounded up; the whole is the same."""
    tenth = rival.scaled(0.1)
    for key, value in dict(rival).items():
        assert getattr(tenth, key) == (-(-value // 10) if key in rival.efforts else value)
    assert rival.scaled(1.0) == rival and rival.efforts
