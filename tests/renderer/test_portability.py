"""Every variant of the kernel is GLSL 4.30 by the letter, as the Khronos reference compiler reads it."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess

import pytest

from weft.renderer.config import ConstantLight, LanczosFilter, PerspectiveCamera, RenderConfig
from weft.renderer.gpu.shader_source import assemble
from weft.renderer.light_config import DiskLight, QuadLight
from weft.renderer.media_config import BallBound, BoxBound, HomogeneousMedium
from weft.renderer.scene import IsotropicPhase, build_scene
from weft.renderer.surface_config import GroundSurface, PrincipledMaterial
from weft.renderer.voxel_pages import voxel_pages_glsl

from .test_transport import TABLE
from .volumes import random_grid, volume

VARIANTS = list(
    itertools.product(("exact", "delta"), ("projected", "isotropic"), ("fiber", "isotropic"), (1, 8), (0, 1))
)
EXTRAS = {
    "surfaces": [GroundSurface(material=PrincipledMaterial())],
    "lights": [
        QuadLight(position_mm=(0, 9, 0), width_mm=1, height_mm=1, radiance=(1, 1, 1)),
        DiskLight(position_mm=(0, 9, 0), radius_mm=1, radiance=(1, 1, 1)),
    ],
    "filter": LanczosFilter(),
    "camera": PerspectiveCamera(aperture_radius_mm=0.1, aperture_blades=6),
}


def kernel_text(tracking, extinction, phase, count, philox, **extras):
    """The assembled kernel with `count` media and pages of voxels."""
    lights = {"lights": [ConstantLight()]}
    config = RenderConfig(tracking=tracking, extinction=extinction, **(lights | extras))
    grids = [random_grid((1, 1, 1), seed=i) for i in range(count)]
    scene = build_scene(
        config, volume(*grids), {"a": TABLE["reference"] if phase == "fiber" else IsotropicPhase()}
    )
    options = {"GROUP_SIZE": 64, "STEPS_PER_ROUND": 24, "SEEKS_PER_ROUND": 32, "RANDOM_KIND": philox}
    options["BRICK_POOL"] = pooled = extras.pop("pooled", False)
    pieces = scene.pieces() | {
        "generated/voxel_pages.glsl": voxel_pages_glsl(count, 16, slot_table=count if pooled else None),
        "generated/parking.glsl": '#include "medium/parking.glsl"\n' if pooled else "",
    }
    return assemble("path/trace.comp", constants=scene.constants() | options, pieces=pieces).text


OTHER_MEDIA = [
    HomogeneousMedium(bound=BallBound(radius_mm=1), extinction_per_mm=(1, 2, 3)),
    HomogeneousMedium(bound=BoxBound(lower_mm=(0, 0, 0), upper_mm=(1, 1, 1)), extinction_per_mm=1),
]
CHOICES = [
    (("exact", "projected", "fiber", 2, 2), {"media": OTHER_MEDIA}),
    (("exact", "projected", "isotropic", 1, 3), {"media": OTHER_MEDIA[1:]}),
    (("exact", "projected", "fiber", 2, 3), {"shadow_tracking": "residual_ratio"}),
    (("delta", "projected", "fiber", 1, 2), {"shadow_tracking": "march"}),
    (("delta", "isotropic", "fiber", 1, 0), {"shadow_tracking": "exact"}),
]
"""Media beside the fibers, pairs of estimators, MD5 (2) and Sobol (3)."""


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslang-tools is not installed")
def test_the_reference_compiler_accepts_every_variant(tmp_path):
    choices = [
        (variant, extras | more) for (variant, extras), more in itertools.product(CHOICES, ({}, EXTRAS))
    ]
    for index, (variant, extras) in enumerate([*itertools.product(VARIANTS, ({}, EXTRAS)), *choices]):
        file = tmp_path / f"{index}.comp"
        file.write_text(kernel_text(*variant, **extras))
        check = subprocess.run(["glslangValidator", "-l", file], capture_output=True, text=True, check=False)
        assert check.returncode == 0, f"{variant}: {check.stdout}"
        assert "WARNING" not in check.stdout, f"{variant}: {check.stdout}"


@pytest.mark.parametrize("extras", [{}, EXTRAS], ids=["plain", "with surfaces"])
def test_storage_buffers_stay_within_the_guaranteed_eight(extras):
    """OpenGL 4.3 promises eight storage blocks per compute program; one page of voxels must do with them."""
    text = kernel_text("exact", "projected", "fiber", 1, 0, **extras)
    bindings = re.findall(r"^layout\(std430, binding = (\d+)\)", text, re.MULTILINE)
    assert [int(binding) for binding in bindings] == list(range(8))
