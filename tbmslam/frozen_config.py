"""The base class of all parts of a configuration."""

from collections.abc import Collection
from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

Count = Annotated[int, Field(ge=1)]
Metres = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class FrozenConfig(BaseModel):
    """Immutable values with limits; an unknown name is an error.

    Attributes
    ----------
    PUBLIC
        Names of the parameters that a user would turn. The schema and the printed configuration hold only these. All
        other values are constants of the method: presets and experiments set them, and any
        version may change them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    PUBLIC: ClassVar[Collection[str]] = ()

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the schema of the public parameters, and of the tables that hold some."""
        schema = handler(core)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name in list(properties):
            if name not in cls.PUBLIC and not _refers_to_public(properties[name], handler):
                del properties[name]
        return schema


def _refers_to_public(schema: JsonSchemaValue, handler: GetJsonSchemaHandler) -> bool:
    """Return whether a property is a table, of one kind or of several, that holds any public parameter."""
    kinds = schema.get("oneOf", [schema])
    return any("$ref" in kind and handler.resolve_ref_schema(kind).get("properties") for kind in kinds)
