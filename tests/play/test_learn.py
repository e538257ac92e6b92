"""Agents that learn, watched: against learners that learn the same unwatched."""

import sys
from itertools import islice, pairwise
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pygame
import pytest
import torch

from affmap.env.scene import LAYERS
from affmap.play import learn
from affmap.play.learn import Moment, film, learners_of, moments
from affmap.play.render import HEAD, SCALE
from affmap.settings import ConfigError

STEPS = 100
"""Of a round."""


def two_rounds(kind: str = "random", context_size: int = 3) -> list[Moment]:
    return list(islice(moments(learners_of(kind, "original", context_size)), STEPS + 1))


def test_each_step_of_the_first_agent_is_shown() -> None:
    """The same agent unwatched: places, throttles, and the loss of its first model."""
    shown, alone = two_rounds(), learners_of("random", "original", 3)
    losses = alone.round()
    alone.round()
    first, second = alone.rounds[0]
    np.testing.assert_array_equal([scene.position for scene, _ in shown[:STEPS]], first.true_position[1:])
    np.testing.assert_array_equal([scene.action for scene, _ in shown[:STEPS]], first.action)
    np.testing.assert_array_equal(shown[STEPS].scene.past, second.true_position[:2])
    assert shown[0].line == "random, step 1: knows nothing yet"
    assert shown[STEPS].line == f"random, step 101: training loss of round 1 was \N{MINUS SIGN}{-losses[0]:.1f} nats"


def test_the_map_is_renewed_with_each_round() -> None:
    """The same ground in a round, another one after it; none without a context code."""
    grounds = [scene.ground for scene, _ in two_rounds()]
    assert grounds[0] is not None and all(ground is grounds[0] for ground in grounds[:STEPS])
    assert not np.array_equal(grounds[0], grounds[STEPS])
    assert {scene.ground for scene, _ in two_rounds(context_size=0)} == {None}


def test_a_frame_shows_the_vehicle_where_it_is() -> None:
    """The golden colour at its place, below the line of words, and no goal."""
    learners = learners_of("random", "original", 0)
    *_, frame = film(learners, 5)
    x, y = learners.rounds[0][0].true_position[5]
    pixel = frame[round((2 - y) * SCALE) + HEAD, round(x * SCALE)]
    assert tuple(pixel) == tuple(pygame.Color(LAYERS["vehicle"].color))[:3]
    assert not (frame == tuple(pygame.Color(LAYERS["goal"].color))[:3]).all(-1).any()


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["affmap-learn", *arguments])
    threads = torch.get_num_threads()
    try:
        learn.main()
    except SystemExit as leaving:
        return int(leaving.code or 0)
    finally:
        torch.set_num_threads(threads)
    return 0


def test_the_command_writes_a_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Read back: a frame every 20 of 60 steps, in real time."""
    path = tmp_path / "learning.gif"
    flags = ("--learning", "random", "--steps", "60", "--every", "20", "--output", str(path))
    assert run(monkeypatch, "--world", "fog", *flags) == 0
    assert capsys.readouterr().out == f"The film is {path}\n"
    frames = list(imageio.imiter(path))
    assert len(frames) == 3 and frames[0].shape == (2 * SCALE + HEAD, 3 * SCALE, 3)
    assert imageio.immeta(path)["duration"] == pytest.approx(1000 * 20 / 30, abs=10)


def test_a_window_shows_it_until_it_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a virtual screen: pause, go on, close. While it is paused, nothing moves."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pictures = []
    keys = [None, pygame.K_SPACE, None, None, pygame.K_SPACE, None, pygame.K_q]
    events = iter([[pygame.event.Event(pygame.KEYDOWN, key=key)] if key else [] for key in keys])
    monkeypatch.setattr(pygame.event, "get", lambda: next(events))
    blit = pygame.surfarray.blit_array

    def blitted(screen: pygame.Surface, picture: np.ndarray) -> None:
        pictures.append(picture.copy())
        blit(screen, picture)

    monkeypatch.setattr(pygame.surfarray, "blit_array", blitted)
    learn.watch(learners_of("random", "original", 0))
    same = [np.array_equal(one, other) for one, other in pairwise(pictures)]
    assert same == [False, True, True, True, False]
    assert not pygame.display.get_init()


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (
            "offline",
            "--learning offline explores first and learns later; choose deviation, disagreement, goals, information, "
            "random",
        ),
        ("greed", "--learning greed does not exist; there are: deviation, disagreement, goals, information, random"),
    ],
)
def test_kinds_that_do_not_learn_online_are_refused(kind: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        learners_of(kind, "original")


@pytest.mark.parametrize(
    ("world", "told"),
    [
        ("moon", r"^conf/layout/moon\.yaml does not exist"),
        ("procedural_easy", "--world procedural_easy has rules for worlds, and agents learn in one; name a layout"),
    ],
)
def test_worlds_in_which_no_agent_can_learn_are_refused(world: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        learners_of("random", world)
