"""Names of stages: what they depend on, beside stored digests (`tests/test_digests.py`)."""

from dataclasses import replace
from typing import Annotated, Any, Literal

import pytest

from affmap.config import compose
from affmap.config.root import Config
from affmap.env.layout import Circle, Layout
from affmap.model.stack import ModelSettings
from affmap.pipeline.job import stages
from affmap.pipeline.stage import CONTROL, DATA, MAP, TRAIN
from affmap.settings import Neutral, read


class LaterModel(ModelSettings):
    kind: Annotated[Literal["mlp", "gru"], Neutral("mlp")]


class LaterCircle(Circle):
    height: Annotated[float, Neutral(0.0)]


class LaterLayout(Layout):
    circles: tuple[LaterCircle, ...]  # type: ignore[assignment]
    wind: Annotated[tuple[float, float], Neutral((0.0, 0.0))]


class Later(Config):
    """The configuration of a later version: a key more in the model, in layouts, in circles, and at the top."""

    model: LaterModel
    training_layouts: tuple[LaterLayout, ...]  # type: ignore[assignment]
    map_layout: LaterLayout
    control_layout: LaterLayout
    models: Annotated[Literal["train", "reference"], Neutral("train")]


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    """The values of Experiment I's first job, with layouts written out."""
    composed = compose.values(compose.compose(["experiment=exp1", "model.context_size=8"]))
    layout = read("layout", "original")
    return composed | {"training_layouts": [layout], "map_layout": layout, "control_layout": layout}


def names(config: Config) -> dict[str, str]:
    return {stage.name: stage.digest for stage in stages(config)}


def test_a_new_key_at_its_neutral_value_renames_no_stage(values: dict[str, Any]) -> None:
    """The stages of the configuration that lacks it, whether the key is left out or written."""
    before = names(Config.checked(values, "here"))
    del before["predict"], before["map"], before["control"]  # they depend on `models`, which is no new key in truth
    written = values | {"model": values["model"] | {"kind": "mlp"}}
    for later in (values, written):
        actual = names(Later.checked(later, "here"))
        assert {name: actual[name] for name in before} == before


def test_a_new_key_at_another_value_renames_what_depends_on_it(values: dict[str, Any]) -> None:
    first = names(Later.checked(values, "here"))
    recurrent = names(Later.checked(values | {"model": values["model"] | {"kind": "gru"}}, "here"))
    assert {name for name in first if first[name] != recurrent[name]} == {"train", "predict", "map", "control"}
    circles = [circle | {"height": 1.0} for circle in values["map_layout"]["circles"]]
    high = names(Later.checked(values | {"map_layout": values["map_layout"] | {"circles": circles}}, "here"))
    assert {name for name in first if first[name] != high[name]} == {"predict", "map"}


def test_what_was_written_before_a_key_existed_is_read_as_if_it_had_it(values: dict[str, Any]) -> None:
    """The configuration that a stage keeps in its provenance."""
    kept = TRAIN.of(Config.checked(values, "here")).config
    assert LaterModel.model_validate(kept["model"]).kind == "mlp"
    layout = LaterLayout.model_validate(kept["training_layouts"][0])
    assert layout.wind == (0.0, 0.0) and layout.circles[0].height == 0.0


def test_a_raised_version_renames_the_stage_and_those_after_it(values: dict[str, Any]) -> None:
    """Results of the old rules are not found any more, so they are made anew; those before it are."""
    config = Config.checked(values, "here")
    first, train = replace(TRAIN, version=1), replace(TRAIN, version=2)
    maps, control = replace(MAP, needs=train), replace(CONTROL, needs=train, version=1)
    assert DATA.of(config).rules == first.of(config).rules == {}
    assert train.of(config).rules == maps.of(config).rules == control.of(config).rules == {"train": 2}
    for old, new in (
        (first, train),
        (replace(maps, needs=first), maps),
        (replace(control, needs=first), control),
    ):
        assert old.of(config).digest != new.of(config).digest
        assert old.of(config).config == new.of(config).config
    assert replace(control, version=3).of(config).rules == {"train": 2, "control": 3}
