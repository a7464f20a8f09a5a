"""Settings of the render stage: picture, camera, lights, transport."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from weft.files.input_file import InputFile
from weft.files.when_met import ByKind

from .light_config import DiskLight, MeshLight, PointLight, QuadLight, SoftboxLight, SpotLight
from .media_config import Medium
from .settings import Color, Reflectance, Settings, Vector
from .surface_config import BallSurface, GroundSurface, MeshSurface, Stencil, SweepSurface, TubeSurface

MAX_PIXELS = 1 << 25
RANDOM_KINDS = ("pcg4d", "philox", "md5", "sobol")
"""In the order of shaders/rng/random.glsl."""


class _Camera(Settings):
    """Framing shared by both cameras. With nothing set, the whole volume is seen from its broad side."""

    name: str = Field(default="", pattern=r"^[A-Za-z0-9_-]*$", max_length=64)
    """Goes into the name of the picture's files; needed where there are several cameras."""
    position_mm: Vector | None = None
    """Where the camera stands; unset: far enough along `view_direction` for the frame to fit."""
    target_mm: Vector | None = None
    """What the camera looks at; unset: the middle of the volume."""
    view_direction: Vector | None = None
    """From the target toward the camera, where `position_mm` is unset; unset: across the thinnest side."""
    up: Vector = (0.0, 1.0, 0.0)
    """Roughly upward in the picture; where it is along the view, -z is up (a cloth lying on the ground)."""
    frame_width_mm: float | None = Field(default=None, gt=0)
    """Width of what is seen at the target, for a close-up; unset: the volume fits."""
    orbit_deg: float = 0.0
    """Then the camera goes around the middle of the volume, counterclockwise seen along `orbit_axis`."""
    orbit_axis: Literal["x", "y", "z"] = "y"
    """The axis it goes around, seen from its tip."""


class PerspectiveCamera(_Camera):
    """A pinhole, or a thin lens where the aperture has a radius."""

    kind: Literal["perspective"] = "perspective"
    fov_deg: float = Field(default=30.0, gt=0, lt=179)
    """Horizontal field of view."""
    aperture_radius_mm: float = Field(default=0.0, ge=0)
    """Of the lens; of a polygon, to its corners. 0: a pinhole, sharp everywhere."""
    aperture_blades: int = Field(default=0, ge=0, le=64)
    """Corners of the aperture, whose shape bright points out of focus take; 0: a circle."""
    aperture_rotation_deg: float = 0.0
    """Turn of a polygonal aperture, counterclockwise in the picture; at 0 a corner points right."""
    focus_distance_mm: float | None = Field(default=None, gt=0)
    """From the lens to the plane that is sharp, along the view; unset: to the target."""

    distortion_k1: float = Field(default=0.0, ge=-10, le=10)
    """Radial distortion: what is r focal lengths from the axis is seen at r (1 + k1 r^2 + k2 r^4)."""
    distortion_k2: float = Field(default=0.0, ge=-10, le=10)
    """Below zero a barrel, above it a cushion; as in OpenCV. `fov_deg` is that without distortion."""

    @model_validator(mode="after")
    def _polygon_or_circle(self) -> PerspectiveCamera:
        if self.aperture_blades in (1, 2):
            raise ValueError(f"aperture_blades = {self.aperture_blades}: a polygon has 3 or more, a circle 0")
        unused = ("focus_distance_mm", "aperture_blades", "aperture_rotation_deg")
        if self.aperture_radius_mm == 0 and (given := [name for name in unused if getattr(self, name)]):
            raise ValueError(f"{', '.join(given)} without aperture_radius_mm has no effect")
        return self

    @model_validator(mode="after")
    def _position_or_frame(self) -> PerspectiveCamera:
        if self.position_mm is not None and self.frame_width_mm is not None:
            raise ValueError("frame_width_mm places the camera; leave it out where position_mm does")
        return self


class OrthographicCamera(_Camera):
    """Parallel rays along the view."""

    kind: Literal["orthographic"] = "orthographic"


class BoxFilter(Settings):
    """Every sample counts for the pixel it lies in, and equally."""

    kind: Literal["box"] = "box"


class GaussianFilter(Settings):
    """A Gaussian, lowered to reach zero at its radius."""

    kind: Literal["gaussian"] = "gaussian"
    radius_px: float = Field(default=1.5, gt=0, le=16)
    """Where it ends, along x and along y."""
    sigma_px: float = Field(default=0.5, ge=0.05, le=16)
    """Standard deviation."""


class LanczosFilter(Settings):
    """A sinc in a sinc window. Sharper than the others, and negative in places: edges may ring."""

    kind: Literal["lanczos"] = "lanczos"
    radius_px: float = Field(default=1.2, gt=0, le=16)
    """Where it ends, along x and along y. The thesis uses 1.2 and tau = 3."""
    tau: float = Field(default=3.0, ge=0.5, le=16)
    """Width of the window: sinc(x) sinc(x / tau)."""


class ConstantLight(Settings):
    """The same radiance from everywhere."""

    kind: Literal["constant"] = "constant"
    radiance: Color = (1.0, 1.0, 1.0)
    """Linear RGB radiance."""


class EnvironmentLight(Settings):
    """A latitude-longitude picture (.exr) around the scene. Up is +y; its left edge looks to -z."""

    kind: Literal["environment"] = "environment"
    file: InputFile
    """OpenEXR file, twice as wide as high."""
    intensity: float = Field(default=1.0, ge=0)
    """Factor on the picture's radiance."""
    rotation_deg: float = 0.0
    """Turn about the y axis, counterclockwise seen from above."""


class DirectionalLight(Settings):
    """Parallel light, as from the sun."""

    kind: Literal["directional"] = "directional"
    direction: Vector
    """From the scene toward the light; need not be of unit length."""
    irradiance: Color = (1.0, 1.0, 1.0)
    """On a surface facing the light."""
    relative_to: Literal["world", "camera"] = "world"
    """camera: x is right, y up, z toward the camera."""


class StudioLight(Settings):
    """Softboxes around the camera, made for this program: a key, a fill, a strip behind, and dim walls."""

    kind: Literal["studio"] = "studio"
    intensity: float = Field(default=1.0, ge=0)
    """Factor on all of it."""
    rotation_deg: float = 0.0
    """Turn about the picture's upward axis; positive moves the key light from the left toward the camera."""


class SkyLight(Settings):
    """A clear sky gradient over a gray ground, in world directions; add a directional light for the sun."""

    kind: Literal["sky"] = "sky"
    intensity: float = Field(default=1.0, ge=0)
    """Factor on all of it."""
    zenith: Color = (0.25, 0.45, 0.9)
    """Radiance straight up."""
    horizon: Color = (0.9, 0.95, 1.0)
    """Radiance at the horizon."""
    ground: Color = (0.2, 0.19, 0.18)
    """Radiance from below."""


class DaylightLight(Settings):
    """Clear sky and sun (Preetham et al. 1999), in world directions; brightness 1 is 10,000 cd/m2."""

    kind: Literal["daylight"] = "daylight"
    sun_elevation_deg: float = Field(default=40.0, ge=1, le=90)
    """Of the sun over the horizon."""
    sun_azimuth_deg: float = -40.0
    """Of the sun around +y, from +z toward +x."""
    turbidity: float = Field(default=3.0, ge=2, le=10)
    """2 very clear, 3 clear, 6 hazy."""
    intensity: float = Field(default=0.3, ge=0)
    """Factor on all of it."""
    sun: bool = True
    """With the sun itself, as parallel light; otherwise the sky alone, as in its shade."""
    ground: Reflectance = (0.2, 0.19, 0.18)
    """What the ground below the horizon reflects."""


Camera = Annotated[PerspectiveCamera | OrthographicCamera, ByKind()]
Surface = Annotated[MeshSurface | GroundSurface | BallSurface | TubeSurface | SweepSurface, ByKind()]
PixelFilter = Annotated[BoxFilter | GaussianFilter | LanczosFilter, ByKind()]
Light = Annotated[
    ConstantLight
    | EnvironmentLight
    | DirectionalLight
    | StudioLight
    | SkyLight
    | DaylightLight
    | PointLight
    | SpotLight
    | QuadLight
    | DiskLight
    | MeshLight
    | SoftboxLight,
    ByKind(),
]


Pixel = Annotated[int, Field(ge=0, lt=16384)]
PixelCount = Annotated[int, Field(ge=1, le=16384)]


class RenderConfig(Settings):
    """One picture of one volume."""

    resolution: tuple[PixelCount, PixelCount] = (512, 512)
    """Width and height in pixels; at most 33 million pixels, whose sums take 5 GiB."""
    samples_per_pixel: int = Field(default=32, ge=1, le=2**24)
    """Paths per pixel."""
    block_samples: int = Field(default=16, ge=1, le=4096)
    """Samples of a pixel that are summed together, a power of two: the least that shares differ by."""
    noise: float | None = Field(default=None, gt=0, lt=1)
    """Stop at about this standard error of a pixel, relative to the picture's mean, in root mean square."""
    time_s: float | None = Field(default=None, gt=0)
    """Stop after about this time; like `noise`, with no more than `samples_per_pixel`."""
    seed: int = Field(default=0, ge=0, lt=2**32)
    """Random numbers are functions of seed, pixel, sample and dimension."""
    rng: Literal["pcg4d", "philox", "md5", "sobol"] = "pcg4d"
    """pcg4d, philox, md5: hashes, of which the first is the fastest. sobol: Owen-scrambled Sobol sequences
    in the first scatterings, with samples spread more evenly; `variance` then says too much."""
    max_bounces: int = Field(default=1024, ge=1, lt=2**31)
    """Scattering events after which a path is cut; cut paths are counted. White fibers need hundreds."""
    roulette_start: int = Field(default=1, ge=1, lt=2**31)
    """Scattering events after which dim paths end by Russian roulette; it changes noise, never the mean."""
    camera: Camera = PerspectiveCamera()
    """The camera."""
    lights: tuple[Light, ...] = Field(default=(StudioLight(),), min_length=1)
    """All lights; those around the scene add up to one environment."""
    lights_turn_deg: float = 0.0
    """Lights of the world turned about the vertical axis through the volume's middle, as `orbit_deg` is."""
    surfaces: tuple[Surface, ...] = Field(default=(), max_length=1024)
    """Meshes and grounds beside the volume."""
    stencil: Stencil | None = None
    """Outside of it the volume is empty; unset: all of the volume is there."""
    media: tuple[Medium, ...] = Field(default=(), max_length=32)
    """Media beside the volume's own: homogeneous ones, and further grids. Those that overlap add up."""
    background: Literal["environment"] | Color = (0.0, 0.0, 0.0)
    """What camera rays see that meet no fiber: a linear color, or the environment."""
    filter: PixelFilter = BoxFilter()
    """How samples around a pixel make its color."""
    crop: tuple[Pixel, Pixel, PixelCount, PixelCount] | None = None
    """Left, top, width and height in pixels of the part to render, with the bits it has in the whole."""
    exposure: float = 0.0
    """Stops applied to the preview only."""
    extinction: Literal["projected", "isotropic"] = "projected"
    """projected: (2 phi / (pi a)) sin(angle to the fiber); isotropic: the density times one scale."""
    isotropic_extinction_per_mm: float | None = Field(default=None, gt=0)
    """Extinction of volume fraction 1, for "isotropic"; unset: the mean of "projected", 1/(2a)."""
    self_shadow_offset_fibers: float = Field(default=0.0, ge=0)
    """Distance skipped after every scattering, so that a fiber's own voxels do not shadow it [fiber radii].

    About 3.5 matches fibers traced one by one; not reciprocal, hence off by default. Of several media the
    thickest fiber counts.
    """
    correlation: Literal["none", "fibers"] = "none"
    """none: fibers are independent points, as in any participating medium. fibers: free flights know that
    voxels hold few and thick fibers, and that a path meets and leaves a fiber at its surface.

    Within 2 % of yarns traced fiber by fiber (renderer/VOLUME_AGAINST_FIBERS.md), up to voxels of 0.06 mm;
    needs exact tracking and projected extinction.
    """
    brick_pool_mb: float | None = Field(default=None, gt=0)
    """Memory for voxels on the device [MiB]; unset: as much as they need.

    Paths that need other voxels wait for them; the picture is the same, bit by bit.
    """
    detail_pixels: float | None = Field(default=None, gt=0)
    """Largest edge of a voxel in pixels: farther cloth is drawn from coarser levels (`voxelize.levels`).

    Unset: all of it in its finest voxels, exactly. 1 is a voxel a pixel; renderer/README.md says how far
    pictures are off. Less memory and fewer steps the farther the camera.
    """
    outside_batch: Literal["park", "homogeneous"] = "park"
    """What paths meet that leave the frustum of the part of the screen whose voxels are in the pool.

    park: they wait for the true voxels. homogeneous, as in the thesis: a medium of mean density without
    direction. That is biased; it is there to be compared with, and needs brick_pool_mb.
    """
    tracking: Literal["exact", "delta"] = "exact"
    """How free flights end. exact: optical depth voxel by voxel; delta: by collisions with a majorant of each
    brick, some of which are with nothing. Both have the same mean."""
    shadow_tracking: Literal["exact", "ratio", "residual_ratio", "march"] | None = None
    """How much light passes from a light: voxel by voxel, by ratio or residual ratio tracking, all with one
    mean, or by ray marching, which lets too much pass. Unset: exact, and ratio with tracking = "delta"."""
    march_step_mm: float | None = Field(default=None, gt=0)
    """How far ray marching goes between two looks at the volume; unset: a voxel."""
    sampling: Literal["both", "both_plain", "lights", "phase"] = "both"
    """How environment light is found: by choosing lights, by the phase function, or by both. Same mean.

    both: of the environment only what is brighter than its mean is looked for, the rest is left to the phase
    function (MIS compensation). both_plain: all of it is looked for, at every scattering.
    """

    @field_validator("resolution")
    @classmethod
    def _film_fits_memory(cls, resolution: tuple[int, int]) -> tuple[int, int]:
        if resolution[0] * resolution[1] > MAX_PIXELS:
            raise ValueError(f"{resolution[0]} x {resolution[1]} pixels; at most {MAX_PIXELS} in all")
        return resolution

    @field_validator("block_samples")
    @classmethod
    def _power_of_two(cls, block_samples: int) -> int:
        if block_samples & (block_samples - 1):
            nearest = 1 << (block_samples.bit_length() - 1)
            raise ValueError(f"{block_samples} is no power of two; {nearest} is")
        return block_samples

    @model_validator(mode="after")
    def _crop_lies_in_the_picture(self) -> RenderConfig:
        x, y, width, height = self.window
        if x + width > self.resolution[0] or y + height > self.resolution[1]:
            picture = f"{self.resolution[0]} x {self.resolution[1]}"
            raise ValueError(f"crop ends at ({x + width}, {y + height}), outside of the picture, {picture}")
        return self

    @property
    def window(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of what is rendered [pixels]."""
        return self.crop or (0, 0, *self.resolution)

    @model_validator(mode="after")
    def _scale_needs_isotropic(self) -> RenderConfig:
        if self.isotropic_extinction_per_mm is not None and self.extinction != "isotropic":
            raise ValueError('isotropic_extinction_per_mm has no effect unless extinction = "isotropic"')
        return self

    @property
    def shadows_by(self) -> str:
        """How shadow rays are tracked."""
        return self.shadow_tracking or ("exact" if self.tracking == "exact" else "ratio")

    @model_validator(mode="after")
    def _media_need_exact_tracking(self) -> RenderConfig:
        if self.media and (self.tracking, self.shadows_by, self.correlation) != ("exact", "exact", "none"):
            raise ValueError('media need tracking and shadow_tracking = "exact" and correlation = "none"')
        return self

    @model_validator(mode="after")
    def _steps_need_marching(self) -> RenderConfig:
        if self.march_step_mm is not None and self.shadows_by != "march":
            raise ValueError('march_step_mm has no effect unless shadow_tracking = "march"')
        return self

    @model_validator(mode="after")
    def _homogeneous_needs_a_pool(self) -> RenderConfig:
        if self.outside_batch == "homogeneous" and self.brick_pool_mb is None:
            raise ValueError('outside_batch = "homogeneous" has no effect without brick_pool_mb')
        return self

    @model_validator(mode="after")
    def _detail_is_of_fibers_alone(self) -> RenderConfig:
        for name, used in (("media", self.media), ("outside_batch", self.outside_batch != "park")):
            if self.detail_pixels is not None and used:
                raise ValueError(f"detail_pixels and {name} do not go together; leave one of them out")
        return self

    @model_validator(mode="after")
    def _correlation_needs_exact_tracking(self) -> RenderConfig:
        if self.correlation == "fibers":
            if (self.tracking, self.shadows_by) != ("exact", "exact") or self.extinction != "projected":
                raise ValueError(
                    'correlation = "fibers" needs tracking = "exact" and extinction = "projected"'
                )
            if self.self_shadow_offset_fibers > 0:
                raise ValueError(
                    'correlation = "fibers" leaves the own fiber out; drop self_shadow_offset_fibers'
                )
        return self
