"""Threads of PyTorch: those asked for inside, those of the caller outside."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch

import affmap
from affmap.control.agent import Agent
from affmap.settings import ConfigError
from affmap.threads import limited


@pytest.fixture
def three() -> Iterator[None]:
    """A caller that has three threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("three")
def test_the_number_is_put_back_after_an_error_too() -> None:
    with pytest.raises(ZeroDivisionError), limited(2):
        1 // (torch.get_num_threads() - 2)
    assert torch.get_num_threads() == 3
    for wrong in (0, 1.5, "x"):
        told = rf"^threads = {wrong!r} is not allowed; give a whole number, 1 or more\.$"
        with pytest.raises(ConfigError, match=told), limited(wrong):  # type: ignore[arg-type]
            pass


@pytest.mark.usefixtures("three")
def test_flights_have_one_thread_or_those_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """As counted while an agent is loaded, brought into a world and acts; each leaves the caller's number."""
    seen: list[int] = []
    act, elsewhere = Agent.act, Agent.elsewhere

    def counted(function):  # type: ignore[no-untyped-def]
        def call(*arguments):  # type: ignore[no-untyped-def]
            seen.append(torch.get_num_threads())
            return function(*arguments)

        return call

    monkeypatch.setattr(Agent, "act", counted(act))
    monkeypatch.setattr(Agent, "elsewhere", counted(elsewhere))
    agent = affmap.load()
    agent.settings = agent.settings.model_copy(update={"num_steps": 2})
    env = affmap.VehicleEnv("two_obstacles")
    observation, _ = env.reset(seed=0)
    for threads in (1, 2):
        options = {} if threads == 1 else {"threads": threads}
        seen.clear()
        affmap.fly(agent, "two_obstacles", **options)
        assert np.isfinite(affmap.Pilot(agent, "two_obstacles", **options)(observation)).all()
        assert seen == [threads] * 5 and torch.get_num_threads() == 3
