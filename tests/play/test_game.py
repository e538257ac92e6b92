"""The game without a window: what the player does has the effect that it should have, and nothing else."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from affmap.control.agent import Agent
from affmap.env.layout import Layout
from affmap.play.game import Game
from affmap.settings import ConfigError, folder


@pytest.fixture
def game() -> Game:
    return Game("exp1")


def test_the_agent_arrives(game: Game) -> None:
    """Experiment I's agents do, in its world: within 120 steps."""
    for _ in range(120):
        game.step()
    assert game.distance < 0.1 and len(game.past) == 121 and game.thought is not None


def test_a_new_goal_is_flown_to(game: Game) -> None:
    game.set_goal((1.5, 1.0))
    for _ in range(80):
        game.step()
    assert np.hypot(*(game.past[-1] - (1.5, 1.0))) < 0.15
    game.set_goal((99.0, -1.0))
    assert game.env.goal.tolist() == [3.0, 0.0]


def test_the_player_flies_by_hand(game: Game) -> None:
    """The two throttles that push to the right, then none that thinks."""
    game.enter("original")
    game.by_hand, start = True, game.past[0]
    game.throttles = np.array([1.0, 0.0, 0.0, 1.0]) if start[0] < 1.5 else np.array([0.0, 1.0, 1.0, 0.0])
    for _ in range(10):
        game.step()
    assert abs(game.past[-1][0] - start[0]) > 0.2 and abs(game.past[-1][1] - start[1]) < 1e-6
    assert game.thought is None


def test_while_paused_the_agent_thinks_and_does_not_move(game: Game) -> None:
    game.step(paused=True)
    first = game.thought
    game.step(paused=True)
    assert game.thought is first is not None and len(game.past) == 1
    game.set_goal((1.5, 1.0))
    game.step(paused=True)
    assert game.thought is not first


def test_everything_about_the_agent_can_be_changed_in_flight(game: Game) -> None:
    """The vehicle stays where it is; the agent is another one."""
    game.step()
    place = game.past[-1]
    for size in (0, 1, 3, 5, 8):
        game.change(context_size=size)
        assert game.code.shape == (size,) and (game.ground is None) == (size == 0)
    codes = {}
    for lookup in ("map", "exact"):
        game.change(lookup=lookup)
        codes[lookup] = game.code
    np.testing.assert_allclose(codes["map"], codes["exact"], atol=0.1)
    game.change(planner="gradient", beta=100.0)
    game.step(paused=True)
    assert game.thought is not None and len(game.thought.candidates) == 1
    assert game.past[-1] is place and game.setting.beta == 100


def test_a_circle_can_be_moved_and_map_and_view_with_it(game: Game) -> None:
    """The obstacle goes to the middle: what is seen and flown around is there; what was there is free."""
    game.step()
    number = game.circle_at((0.75, 0.5))
    assert number is not None and game.circle_at((1.5, 1.0)) is None
    before = game.ground
    assert before is not None
    game.move_circle(number, (1.5, 1.0))
    assert game.circle_at((1.5, 1.0)) == number and game.circle_at((0.75, 0.5)) is None
    assert game.ground is not None and not np.allclose(game.ground[25, 37], before[25, 37])
    np.testing.assert_allclose(game.ground[2, 70], before[2, 70])  # far from it
    middles = game.env.probe([[1.5, 1.0], [0.75, 0.5]])[:, 0, 5, 5]
    assert middles.tolist() == [True, False]
    assert game.layout.map != game.env.layout.load("layout", "original").map


def test_moving_a_circle_reads_no_files(game: Game, monkeypatch: pytest.MonkeyPatch) -> None:
    game.move_circle(0, (1.5, 1.0))
    monkeypatch.setattr("affmap.control.pretrained.load", lambda *_, **__: pytest.fail("read again"))
    game.move_circle(0, (1.4, 1.0))


def test_a_circle_that_would_cover_a_corner_or_the_vehicle_stays(game: Game) -> None:
    place = game.layout.circles[0].center
    for point in ((0.05, 0.05), tuple(game.past[-1])):
        game.move_circle(0, point)
        assert game.layout.circles[0].center == place and "may cover neither" in game.message
    game.move_circle(0, (1.5, 1.0))
    assert game.message == ""


def test_worlds_are_those_that_the_models_can_see() -> None:
    game = Game("exp5")
    assert game.world == "four_properties" and "original" not in game.worlds
    for world in game.worlds:
        game.enter(world)
        game.step()
    with pytest.raises(ConfigError, match="'original' is not one that these models can see: four_properties"):
        Game("exp5", "original")
    with pytest.raises(ConfigError, match="none of 7"):
        Game("exp1", context_size=7)


def test_what_a_system_leaves_beside_layouts_and_planners_is_none_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As macOS leaves it on other disks."""
    conf = tmp_path / "conf"
    shutil.copytree(folder(), conf)
    for name in ("layout/._original.yaml", "planner/._cem.yaml"):
        (conf / name).write_bytes(b"\x00\x05\x16\x07")
    monkeypatch.setattr("affmap.settings.base.folder", lambda: conf)
    monkeypatch.setattr("affmap.settings.base.own_folder", lambda: None)
    game = Game("exp1")
    assert "original" in game.worlds and game.planners == Game("exp1").planners == ["cem", "gradient"]


def test_a_broken_layout_is_told_only_to_those_who_ask_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be read, and one whose circle has no place; the others can be played."""
    monkeypatch.chdir(tmp_path)
    before = Game("exp1").worlds
    own = tmp_path / "conf" / "layout"
    own.mkdir(parents=True)
    (own / "torn.yaml").write_text("name: [", "utf-8")
    text = (folder() / "layout" / "original.yaml").read_text("utf-8")
    (own / "odd.yaml").write_text(text.replace("obstacle", "obstcle").replace("name: original", "name: odd"), "utf-8")
    game = Game("exp1")
    assert game.worlds == before
    for name in ("torn", "odd"):
        with pytest.raises(ConfigError, match=f"conf/layout/{name}.yaml"):
            game.enter(name)


def test_the_transition_model_can_be_chosen() -> None:
    """Of those of Experiment VI, of which the first is the perceptron."""
    for name, kind in ((None, "mlp"), ("split", "split")):
        game = Game("exp6", "pairs_and_triples", transition=name)
        agent = game._pilot.agent
        assert isinstance(agent, Agent) and agent.stack.settings.transition.kind == kind
        game.change(beta=10.0)
        game.step()
    with pytest.raises(ConfigError, match="none is 'gru'"):
        Game("exp6", transition="gru")


def test_a_guide_shows_the_way_and_the_times_to_go(game: Game) -> None:
    """From the vehicle to the goal, and lines around it; to a new goal once the agent has seen it; none by hand."""
    assert game.way is None and game.times == []
    game.change(guide="time_to_go")
    game.step()
    assert game.way is not None
    np.testing.assert_allclose(game.way[[0, -1]], [game.past[-1], game.env.goal], atol=1e-6)
    assert len(game.times) > 5 and all(line.shape[1] == 2 and len(line) > 1 for line in game.times)
    game.set_goal((1.5, 1.0))
    assert game.way is None
    game.step(paused=True)
    game.step()
    assert game.way is not None
    np.testing.assert_allclose(game.way[-1], [1.5, 1.0])
    game.by_hand = True
    assert game.way is None and game.times == []


def test_walls_can_be_played() -> None:
    """The world that member 0 flies in first."""
    game = Game("exp5", "spiral")
    assert game.layout.name == "spiral" and len(game.layout.circles) > 50


def test_doors_open_and_close_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """With models of other worlds that have as many channels: by hand over the key, then the agent; then a restart."""
    layout = Layout.load(
        "layout",
        "original",
        circles=[
            {"center": [1.5, 1.0], "radius": 0.3, "effect": "door", "channel": "solid"},
            {"center": [0.8, 0.2], "radius": 0.1, "effect": "key", "channel": "solid"},
        ],
    )
    monkeypatch.setattr("affmap.play.game.first_layout", lambda *names, **seeds: layout)
    game = Game("exp1")
    game.change(guide="time_to_go")
    game.step()
    ground, number = game.ground, game.circle_at((1.5, 1.0))
    assert ground is not None and number == 0 and game.way is not None
    game.env.reset(seed=0, options={"position": [0.6, 0.2], "goal": [2.5, 1.5]})
    game.by_hand, game.throttles = True, np.array([1.0, 0, 0, 1])
    for _ in range(5):
        game.step()
    assert game.env.layout == layout.opened and game.circle_at((1.5, 1.0)) is None
    assert game.ground is not None and (game.ground != ground).any()
    game.by_hand = False
    game.step()
    assert game.way is not None
    game.reset()
    assert game.env.layout == layout and game.circle_at((1.5, 1.0)) == number
    assert game.ground is not None
    np.testing.assert_allclose(game.ground, ground)
