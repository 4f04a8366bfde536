from typing import Annotated, ClassVar, Literal

import pytest
from pydantic import Field, ValidationError

from merging.config import MergeConfig
from tbmslam.configuration.slam_config import SlamConfig
from tbmslam.frozen_config import FrozenConfig
from tools.command_line.configuration import Configuration


class Steep(FrozenConfig):
    PUBLIC: ClassVar = ("angle",)
    kind: Literal["steep"] = "steep"
    angle: float = 1.0


class Flat(FrozenConfig):
    kind: Literal["flat"] = "flat"
    length: float = 1.0


class Constants(FrozenConfig):
    step: float = 0.1


class Whole(FrozenConfig):
    PUBLIC: ClassVar = ("size",)
    size: float = 2.0
    constant: float = 3.0
    slope: Annotated[Steep | Flat, Field(discriminator="kind")] = Steep()
    constants: Constants = Constants()


def public_names(schema, place=None):
    """Return the dotted names of all parameters in a JSON schema."""
    properties = (place or schema)["properties"]
    names = set()
    for name, about in properties.items():
        kinds = [
            schema["$defs"][kind["$ref"].rpartition("/")[2]] for kind in about.get("oneOf", [about]) if "$ref" in kind
        ]
        tables = [kind for kind in kinds if "properties" in kind]
        names |= {f"{name}.{below}" for table in tables for below in public_names(schema, table)} if tables else {name}
    return names


def test_the_schema_holds_public_parameters_and_the_tables_that_have_some():
    assert public_names(Whole.model_json_schema()) == {"size", "slope.angle"}


def test_constants_can_be_set_and_unknown_names_cannot():
    assert Whole(constant=4.0).constant == 4.0
    with pytest.raises(ValidationError, match="other"):
        Whole(other=1.0)


def test_a_user_sees_sixty_parameters_at_the_most():
    assert len(public_names(Configuration.model_json_schema())) <= 60
    assert {"map.resolution", "loop_closing.enabled", "tracker.kind"} <= public_names(SlamConfig.model_json_schema())
    assert {"rule", "verification.min_confidence"} <= public_names(MergeConfig.model_json_schema())
