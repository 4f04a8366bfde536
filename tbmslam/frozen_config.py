"""What every part of a configuration is made of."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(ge=1)]
Metres = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class FrozenConfig(BaseModel):
    """Values with limits that nobody changes later; a name that none of them has is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")
