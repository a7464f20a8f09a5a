"""What the settings of this room share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]
Color = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
"""Linear RGB."""
Share = Annotated[float, Field(ge=0, le=1)]
Reflectance = tuple[Share, Share, Share]
"""Linear RGB, no more than all light."""


class Settings(BaseModel):
    """Frozen, complete, finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
