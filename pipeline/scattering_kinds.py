"""The [scattering] table: fibers, or a simple phase function for comparison with other renderers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from weft.fiber_model.scattering.config import ScatteringConfig
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.files.when_met import ByKind, WhenMet
from weft.renderer.media_config import HenyeyGreensteinScattering, IsotropicScattering, SggxScattering
from weft.renderer.simple_phases import SimplePhase

Scattering = FiberScatteringParameters | SimplePhase
SimpleScattering = Annotated[IsotropicScattering | HenyeyGreensteinScattering | SggxScattering, ByKind()]


class IsotropicTable(IsotropicScattering):
    """The same into all directions; `by_type` gives single yarn types scattering of their own."""

    by_type: dict[str, SimpleScattering] = Field(default={})
    """By yarn type, for types that differ."""


class HenyeyGreensteinTable(HenyeyGreensteinScattering):
    """Henyey and Greenstein 1941; `by_type` gives single yarn types scattering of their own."""

    by_type: dict[str, SimpleScattering] = Field(default={})
    """By yarn type, for types that differ."""


class SggxTable(SggxScattering):
    """Specular microflakes along the fibers; `by_type` gives single yarn types scattering of their own."""

    by_type: dict[str, SimpleScattering] = Field(default={})
    """By yarn type, for types that differ. All need one roughness."""


def _kind(table: Any) -> str:
    """Fibers need not say so."""
    kind = table.get("kind", "fibers") if isinstance(table, dict) else getattr(table, "kind", "fibers")
    return str(kind)


ScatteringTable = Annotated[
    Annotated[ScatteringConfig, WhenMet(), Tag("fibers")]
    | Annotated[IsotropicTable, WhenMet(), Tag("isotropic")]
    | Annotated[HenyeyGreensteinTable, WhenMet(), Tag("henyey_greenstein")]
    | Annotated[SggxTable, WhenMet(), Tag("sggx")],
    Discriminator(_kind),
]


def by_medium(table: Any, every_medium: str) -> dict[str, Scattering]:
    """What a [scattering] table says of each yarn type it names, and under `every_medium` of all others."""
    if isinstance(table, ScatteringConfig):
        types: dict[str, Scattering] = {name: table.parameters_for(name) for name in table.by_type}
        return {every_medium: table.to_parameters(), **types}
    types = {name: one.to_phase() for name, one in table.by_type.items()}
    return {every_medium: table.to_phase(), **types}


def described(table: Any) -> str:
    """In a word or two, for the run record."""
    if isinstance(table, ScatteringConfig):
        return table.preset or (table.fit.name if table.fit else "as given")
    return str(table.kind)
