"""An effect of a terrain is named in four places, which must agree."""

from typing import get_args

from affmap.env.layout import Effect
from affmap.env.physics import PULLS
from affmap.env.rendering import COLORS
from affmap.report.arena import EFFECTS


def test_every_effect_has_its_colours_and_every_force_its_pull() -> None:
    """The names in `Effect`; arrows of reports point where the forces pull."""
    effects = set(get_args(Effect))
    assert set(COLORS) == set(EFFECTS) == effects
    assert set(PULLS) == {effect for effect in effects if effect.startswith("force_")}
    assert {effect: arrow for effect, (_, _, arrow) in EFFECTS.items() if arrow} == PULLS
