"""The table of effects: what each line must be, and that a line is all that a new force needs."""

import numpy as np
import pytest

from affmap.env.body import Vehicle
from affmap.env.effects import EFFECTS, PULLS, Effect
from affmap.env.layout import Circle, Layout
from affmap.env.physics import Physics
from affmap.env.rendering import Canvas
from affmap.env.scene import Scene
from affmap.report.drawing.arena import effect_handles


def test_every_effect_can_be_told_from_the_others() -> None:
    assert len({effect.label for effect in EFFECTS.values()}) == len(EFFECTS)
    assert len({effect.color for effect in EFFECTS.values()}) == len(EFFECTS)
    assert {name: effect.pull for name, effect in EFFECTS.items() if effect.pull} == PULLS
    assert all(np.linalg.norm(pull) == pytest.approx(1) for pull in PULLS.values())


def test_a_line_makes_a_new_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """As docs/configuration.md says: it can be laid out, it pulls, and pictures and legends show it."""
    wind = Effect("blows to the left", "#123456", (-1.0, 0.0))
    monkeypatch.setitem(EFFECTS, "wind", wind)
    monkeypatch.setitem(PULLS, "wind", wind.pull)
    circle = Circle(center=(1.5, 1.0), radius=0.3, effect="wind", channel="solid")
    layout = Layout.load("layout", "original", circles=[circle])
    vehicle = Vehicle.load("vehicle", "default")
    physics = Physics(layout, vehicle, np.array([1.5, 1.0]))
    physics.step(np.zeros(4))
    assert physics.velocity[0] < 0 and physics.velocity[1] == 0
    canvas = Canvas(layout.size, window=False)
    canvas.draw(Scene(layout, vehicle.radius, np.array([0.2, 0.2]), np.array([2.8, 1.8])))
    height, width, _ = canvas.array().shape
    half = [round((255 + part) / 2) for part in (0x12, 0x34, 0x56)]
    assert canvas.array()[height // 2 + 10, width // 2].tolist() == pytest.approx(half, abs=1), "beside its arrow"
    assert [handle.get_label() for handle in effect_handles([layout])] == ["blows to the left"]
