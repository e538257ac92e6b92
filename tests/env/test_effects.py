"""The table of effects: what each line must be, and that a line of a user's is all that a new one needs."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import jobs

from affmap.env.body import Vehicle
from affmap.env.effects import EFFECTS, Effect, check_effect, pulls, register_effect
from affmap.env.geometry import crossable
from affmap.env.layout import Circle, Layout
from affmap.env.physics import Physics
from affmap.env.rendering import Canvas
from affmap.env.scene import Scene
from affmap.report.drawing.arena import effect_handles
from affmap.results.failures import nearest, things
from affmap.settings import ConfigError, folder

VEHICLE = Vehicle.load("vehicle", "default")


@pytest.fixture(autouse=True)
def table() -> Iterator[None]:
    """What a test registers is gone afterwards."""
    before = dict(EFFECTS)
    yield
    EFFECTS.clear()
    EFFECTS.update(before)


def layout(effect: str, radius: float = 0.3, *others: Circle) -> Layout:
    circle = Circle(center=(1.5, 1.0), radius=radius, effect=effect, channel="solid")
    return Layout.load("layout", "original", circles=[circle, *others])


def test_every_effect_can_be_told_from_the_others() -> None:
    assert len({effect.label for effect in EFFECTS.values()}) == len(EFFECTS)
    assert len({effect.color for effect in EFFECTS.values()}) == len(EFFECTS)
    assert set(pulls()) == {"force_up", "force_down"}
    assert all(np.linalg.norm(pull) == pytest.approx(1) for pull in pulls().values())


@pytest.mark.parametrize("wrong", [lambda offset, velocity: -offset, "blows", None])
def test_something_else_than_an_effect_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"^the effect 'wind' is .*; give affmap\.Effect\(label, color\), with a pull"):
        register_effect("wind", wrong)
    assert "wind" not in EFFECTS


def test_a_line_makes_a_new_pull() -> None:
    """It can be laid out, it pulls; pictures, legends and tables of failures show it, below fog and what is solid."""
    register_effect("wind", Effect("blows to the left", "#123456", (-1.0, 0.0)))
    assert list(EFFECTS)[-5:] == ["wind", "fog", "key", "door", "obstacle"]
    windy = layout("wind")
    physics = Physics(windy, VEHICLE, np.array([1.5, 1.0]))
    physics.step(np.zeros(4))
    assert physics.velocity[0] < 0 and physics.velocity[1] == 0
    canvas = Canvas(windy.size, window=False)
    canvas.draw(Scene(windy, VEHICLE.radius, np.array([0.2, 0.2]), np.array([2.8, 1.8])))
    height, width, _ = canvas.array().shape
    half = [round((255 + part) / 2) for part in (0x12, 0x34, 0x56)]
    assert canvas.array()[height // 2 + 10, width // 2].tolist() == pytest.approx(half, abs=1), "beside its arrow"
    assert [handle.get_label() for handle in effect_handles([windy])] == ["blows to the left"]
    assert nearest(np.array([1.5, 1.0]), windy) == "wind" and things()["wind"] == "blows to the left"


def test_a_force_that_is_constant_is_a_pull() -> None:
    """In physics, bit for bit, and where a way is searched: two fields that hold the vehicle back, and one."""
    register_effect("wind", Effect("blows", "#123456", (-1.0, 0.0)))
    strength = VEHICLE.force
    register_effect(
        "gale", Effect("blows, too", "#654321", force=lambda offset, _: np.zeros_like(offset) - [strength, 0])
    )
    paths = []
    for effect in ("wind", "gale"):
        physics = Physics(layout(effect), VEHICLE, np.array([1.3, 1.1]))
        for _ in range(20):
            physics.step(np.array([1.0, 0.2, 0.0, 0.3]))
            paths.append([*physics.position, *physics.velocity])
    np.testing.assert_array_equal(paths[:20], paths[20:])
    start, goal = np.array([0.2, 0.2]), np.array([2.8, 1.8])
    weak, strong = VEHICLE.model_copy(update={"thrust": 0.1}), VEHICLE
    for effect in ("wind", "gale"):
        wall = layout(effect, 1.0)
        assert crossable(wall, strong, start, goal) and not crossable(wall, weak, start, goal)


def test_a_force_knows_the_way_from_the_centre_and_the_velocity() -> None:
    """In u and u/s: what it is called with, against positions and velocities of the vehicle."""
    calls = []

    def record(offset: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        calls.append((offset, velocity))
        return 0 * offset

    register_effect("probe", Effect("probes", "#123456", force=record))
    physics = Physics(layout("probe"), VEHICLE, np.array([1.6, 0.9]))
    calls.clear()
    for _ in range(3):
        before = physics.position, physics.velocity
        physics.step(np.array([1.0, 0.0, 0.0, 1.0]))
        np.testing.assert_array_equal(calls[-1][0], before[0] - [1.5, 1.0])
        np.testing.assert_array_equal(calls[-1][1], before[1] / VEHICLE.time_step_s)
    outside = Physics(layout("probe"), VEHICLE, np.array([0.3, 0.3]))
    outside.step(np.zeros(4))
    assert len(calls) == 3, "it acts where its circle does, and nowhere else"


def test_a_drag_slows_down_as_damping_does() -> None:
    """Closed form: Box2D's damping of a step is v / (1 + dt c), ours a force at its beginning; the difference is
    of second order in the step."""
    drag = 0.4  # kg/s
    register_effect("sand", Effect("brakes", "#123456", force=lambda _, velocity: -drag * velocity))
    speeds = {}
    for effect in ("none", "sand"):
        physics = Physics(layout(effect), VEHICLE, np.array([1.4, 1.0]))
        physics.step(np.array([1.0, 0.0, 0.0, 1.0]))
        start = physics.velocity[0]
        physics.step(np.zeros(4))
        speeds[effect] = physics.velocity[0] / start
    assert speeds["sand"] / speeds["none"] == pytest.approx(1 - VEHICLE.time_step_s * drag / VEHICLE.mass, abs=1e-5)


def test_the_compiled_physics_refuses_a_force(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything runs, too: in the configuration of an oracle, and nowhere else."""
    pytest.importorskip("numba")
    from affmap.env.twin import Twin

    register_effect("sand", Effect("brakes", "#123456", force=lambda _, velocity: -velocity))
    with pytest.raises(ConfigError, match=r"^the effect 'sand' is a force in Python, .*baselines=\[straight,random\]"):
        Twin([layout("sand")], VEHICLE)
    (tmp_path / "conf/layout").mkdir(parents=True)
    text = (folder() / "layout/original.yaml").read_text("utf-8").replace("name: original", "name: beach")
    (tmp_path / "conf/layout/beach.yaml").write_text(text.replace("effect: obstacle", "effect: sand"))
    monkeypatch.chdir(tmp_path)
    assert len(jobs(tmp_path, "world=beach", "agent=planner,random")) == 2
    with pytest.raises(ConfigError, match="the effect 'sand' is a force in Python"):
        jobs(tmp_path, "world=beach", "agent=oracle")


@pytest.mark.parametrize(
    ("name", "effect", "message"),
    [
        ("fog", Effect("fog", "#123456"), "'fog' needs a name of its own"),
        ("a b", Effect("a", "#123456"), "'a b' needs a name of its own"),
        ("mud", Effect("mud", "brown"), "'mud' needs a label, and a colour such as '#c994c7'; it has .*'brown'"),
        ("mud", Effect("mud", "#123456", (1.0, 0.0), lambda offset, _: offset), "has a pull and a force"),
        ("mud", Effect("mud", "#123456", (np.nan, 0.0)), "pull = .* should be a direction"),
        ("mud", Effect("mud", "#123456", force=lambda *_: np.zeros(2)), r"returned shape \[2\], or .* shape \[3, 2\]"),
        ("mud", Effect("mud", "#123456", force=lambda way, _: way + np.inf), "numbers that are not finite"),
    ],
)
def test_a_wrong_effect_is_refused_when_it_is_registered(name: str, effect: Effect, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        register_effect(name, effect)
    assert name == "fog" or name not in EFFECTS


def test_an_unknown_effect_is_told_with_those_that_there_are() -> None:
    with pytest.raises(
        ValueError, match=r"should be one of 'none', .*'obstacle'; one of your own is known once AFFMAP"
    ):
        check_effect("mud")
