"""Settings: what cannot be meant is refused where it is written."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from weft.renderer.config import RenderConfig


def test_defaults_describe_a_picture():
    config = RenderConfig()
    assert config.camera.kind == "perspective"
    assert [light.kind for light in config.lights] == ["studio"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sampels_per_pixel": 4}, "Extra inputs"),
        ({"resolution": (0, 5)}, "greater than or equal to 1"),
        ({"resolution": (16384, 16384)}, "16384 x 16384 pixels; at most"),
        ({"exposure": float("nan")}, "finite"),
        ({"lights": []}, "at least 1"),
        ({"background": (0.5, -1.0, 0.0)}, "greater than or equal to 0"),
        ({"lights": [{"kind": "candle"}]}, "candle"),
        ({"isotropic_extinction_per_mm": 3.0}, "no effect unless"),
        (
            {"camera": {"kind": "perspective", "position_mm": (0, 0, 9), "frame_width_mm": 3}},
            "places the camera",
        ),
        ({"lights": [{"kind": "environment", "file": "nowhere.exr"}]}, "nowhere.exr"),
    ],
)
def test_mistakes_are_named(settings, message):
    with pytest.raises(ValidationError, match=message):
        RenderConfig(**settings)


def test_settings_survive_json():
    config = RenderConfig(
        background="environment", lights=[{"kind": "sky"}, {"kind": "directional", "direction": (1, 2, 3)}]
    )
    assert RenderConfig.model_validate_json(config.model_dump_json()) == config
