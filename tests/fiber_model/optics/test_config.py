"""What the settings refuse."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from weft.fiber_model.optics.config import FiberOpticsConfig

ROUND = {"kind": "circle", "radius_mm": 0.01}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"theta_bin_deg": 7}, "theta_bin_deg must divide 90"),
        ({"phi_bin_deg": 50}, "phi_bin_deg must divide 180"),
        ({"cross_section": {"kind": "ellipse", "semi_axes_mm": (1, 0.04)}}, "at most 20 times"),
        (
            {"cross_section": {"kind": "kidney", "width_mm": 1, "thickness_mm": 0.9, "bend_deg": 200}},
            "thickness_mm must lie between 0.05 and 0.458",
        ),
        (
            {"cross_section": {"kind": "rounded_triangle", "side_mm": 1, "corner_radius_mm": 0.3}},
            "at most 0.28",
        ),
        ({"refractive_index": 0.9}, "greater than or equal to 1.01"),
        ({"absorption_per_mm": float("inf")}, "finite"),
        ({"theta_i_deg": (90,)}, "less than or equal to 85"),
        ({"paths": 0}, "greater than or equal to 1"),
    ],
)
def test_values_out_of_range_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        FiberOpticsConfig(**({"cross_section": ROUND, "refractive_index": 1.5} | settings))


def test_one_absorption_stands_for_three() -> None:
    config = FiberOpticsConfig(cross_section=ROUND, refractive_index=1.5, absorption_per_mm=2)  # type: ignore[arg-type]
    assert config.absorption_per_mm == (2, 2, 2)
