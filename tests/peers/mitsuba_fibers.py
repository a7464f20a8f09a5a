"""The same fibers in Mitsuba 3: `bsplinecurve` with the three lobes as a BSDF, written anew in plain Python.

Nothing is shared with tests/peers/fiber_tracer.py but the parameters: hits and their offset, path tracing,
light sampling and roulette are Mitsuba's, the lobes come from their formulas (thesis section 6.2).
"""

from __future__ import annotations

import bisect
import math
import random
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from tests.peers.fiber_scenes import FIBER_RADIUS_MM, bundle
from tests.peers.fiber_tracer import FiberScene
from weft.fiber_model.scattering.parameters import FiberScatteringParameters

PER_MM = 1000.0
"""Mitsuba's lengths: it starts a ray 9e-5 (1 + largest coordinate) off the surface, 1 % of a radius in mm."""
STEPS = 4
"""Straight pieces per span of a spline for the fibers traced one by one."""


@dataclass(frozen=True)
class SplineFibers:
    """Uniform cubic B-splines."""

    control: np.ndarray
    """[mm], shape [fiber_count, point_count, 3]; the curves go from about the second to the last but one."""
    radius_mm: float = FIBER_RADIUS_MM

    def pieces(self) -> FiberScene:
        """The same curves as straight pieces."""
        t = np.linspace(0, 1, STEPS + 1)[:, None]
        weights = np.concatenate(
            [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3], axis=1
        )
        spans = np.stack([self.control[:, k : self.control.shape[1] - 3 + k] for k in range(4)], axis=2)
        points = np.einsum("tk,fskc->fstc", weights / 6, spans)
        pieces = np.stack([points[:, :, :-1], points[:, :, 1:]], axis=3).reshape(len(points), -1, 2, 3)
        fiber = np.repeat(np.arange(len(points), dtype=np.int32), pieces.shape[1])
        return FiberScene(pieces.reshape(-1, 2, 3).astype(np.float32), fiber, self.radius_mm)


@dataclass(frozen=True)
class View:
    """A square of half the width `half_mm` around the origin in parallel projection, y up."""

    half_mm: float
    resolution: int
    toward: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Unit direction to the camera."""

    def rays(self, samples: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Origins and directions of so many rays per pixel, pixel by pixel, row by row from the top."""
        pixels = np.repeat(np.arange(self.resolution**2), samples)
        row, column = np.divmod(pixels, self.resolution)
        place = np.stack([column, row], axis=1) + rng.random((len(row), 2))
        place = (2 * place / self.resolution - 1) * self.half_mm * [1, -1]
        toward, up = np.array(self.toward), np.array([0.0, 1.0, 0.0])
        right = np.cross(up, toward)
        right /= np.linalg.norm(right)
        origin = 2 * toward + place[:, :1] * right + place[:, 1:] * np.cross(toward, right)
        return origin, np.tile(-toward, (len(row), 1))


def straight_fibers(count: int, *, apart: float = 0.0) -> SplineFibers:
    """Those of `bundle`, seed 6."""
    scene = bundle(count, seed=6, apart=apart)
    starts, stops = (scene.segments[:, k].astype(np.float64).reshape(count, -1, 3) for k in range(2))
    points = np.concatenate([starts, stops[:, -1:]], axis=1)
    before, after = 2 * points[:, :1] - points[:, 1:2], 2 * points[:, -1:] - points[:, -2:-1]
    return SplineFibers(np.concatenate([before, points, after], axis=1))


def wavy_fibers(count: int) -> SplineFibers:
    """Helices around x of radius 0.02 mm at random places, each with a phase of its own."""
    rng = np.random.default_rng(8)
    x = np.arange(-0.7, 0.71, 0.1)
    angle = 2 * np.pi * x / 0.6 + rng.uniform(0, 2 * np.pi, (count, 1))
    control = np.empty((count, len(x), 3))
    control[..., 0] = x
    control[..., 1:] = rng.uniform(-0.15, 0.15, (count, 1, 2))
    control[..., 1:] += 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return SplineFibers(control)


def gauss(x: float, width: float) -> float:
    return math.exp(-0.5 * (x / width) ** 2) / (width * math.sqrt(2 * math.pi))


class Lobes:
    """R, TT, TRT of a gray fiber whose R and TRT are uniform around it; angles in radians."""

    def __init__(self, parameters: FiberScatteringParameters) -> None:
        p = self.parameters = parameters
        assert p.azimuthal_width_trt is None
        assert (p.longitudinal, p.azimuthal) == ("gaussian", "wrapped_normal")
        self.widths = (p.longitudinal_width_r, p.longitudinal_width_tt, p.longitudinal_width_trt)
        theta, step = np.linspace(-np.pi / 2, np.pi / 2, 4001, retstep=True)
        self.knots = np.linspace(0, np.pi / 2, 401)
        gaps = theta + self.knots[:, None]
        self.norms = [
            (np.exp(-0.5 * (gaps / w) ** 2) * np.cos(theta) ** 2).sum(axis=1)
            * (step / (w * math.sqrt(2 * math.pi)))
            for w in self.widths
        ]

    def energies(self, theta_o: float) -> tuple[float, float, float]:
        p = self.parameters
        fresnel = p.fresnel_r[0] + (1 - p.fresnel_r[0]) * (1 - math.cos(theta_o)) ** 5
        t = p.fresnel_tt
        return (
            p.color_r[0] * fresnel,
            p.color_tt[0] * (1 - fresnel) * t,
            p.color_trt[0] * (1 - fresnel) * (1 - t),
        )

    def value(self, theta_o: float, theta_i: float, phi: float) -> float:
        """Σ a_k M_k N_k [1/sr], phi from the azimuth of the outgoing direction."""
        place = abs(theta_o) / (math.pi / 2) * (len(self.knots) - 1)
        low = min(int(place), len(self.knots) - 2)
        part, turn = place - low, 2 * math.pi
        from_opposite = (phi % turn) - math.pi
        through = sum(gauss(from_opposite + k * turn, self.parameters.azimuthal_width_tt) for k in (-1, 0, 1))
        around = (1 / turn, through, 1 / turn)
        total = 0.0
        for energy, width, norms, azimuthal in zip(
            self.energies(theta_o), self.widths, self.norms, around, strict=True
        ):
            norm = norms[low] + part * (norms[low + 1] - norms[low])
            total += energy * gauss(theta_i + theta_o, width) * math.cos(theta_i) / norm * azimuthal
        return total

    def draw(self, theta_o: float, choice: float, rng: random.Random) -> tuple[float, float]:
        """theta_i and phi with density `value` over the albedo; `choice`, uniform, picks the lobe."""
        edges = np.cumsum(self.energies(theta_o)).tolist()
        lobe = min(bisect.bisect(edges, choice * edges[-1]), 2)
        while True:
            theta = rng.gauss(-theta_o, self.widths[lobe])
            if abs(theta) < math.pi / 2 and rng.random() < math.cos(theta) ** 2:
                break
        if lobe == 1:
            return theta, math.pi + rng.gauss(0, self.parameters.azimuthal_width_tt)
        return theta, rng.uniform(0, 2 * math.pi)


def inclination(sine: float) -> float:
    return math.asin(max(-1.0, min(1.0, sine)))


def axis_and_view(si) -> tuple[np.ndarray, np.ndarray, float]:
    """Of a hit, in the surface's frame: the fiber's unit axis, the way back, and its sine to the axis."""
    axis, view = np.array(si.to_local(si.dp_dv)), np.array(si.wi)
    axis = axis / math.sqrt(axis @ axis)
    return axis, view, float(view @ axis)


@cache
def register_lobes(parameters: FiberScatteringParameters) -> str:
    """Name of a BSDF: light leaves to both sides of the surface, with no cosine to its normal."""
    import mitsuba as mi

    lobes = Lobes(parameters)
    sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide | mi.BSDFFlags.Anisotropic
    flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.GlossyTransmission | sides

    class FiberLobes(mi.BSDF):
        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            self.m_components, self.m_flags = [flags], flags

        def eval_pdf(self, ctx, si, wo, active=True):
            axis, view, sine_o = axis_and_view(si)
            light = np.array(wo)
            sine_i = float(light @ axis)
            side, other = view - sine_o * axis, light - sine_i * axis
            cosine = float(side @ other) / math.sqrt(max(float(side @ side) * float(other @ other), 1e-30))
            phi, theta_o = math.acos(max(-1.0, min(1.0, cosine))), inclination(sine_o)
            value = lobes.value(theta_o, inclination(sine_i), phi)
            return mi.Color3f(value), value / sum(lobes.energies(theta_o))

        def eval(self, ctx, si, wo, active=True):
            return self.eval_pdf(ctx, si, wo)[0]

        def pdf(self, ctx, si, wo, active=True):
            return self.eval_pdf(ctx, si, wo)[1]

        def sample(self, ctx, si, sample1, sample2, active=True):
            axis, view, sine = axis_and_view(si)
            side = view - sine * axis
            side /= math.sqrt(side @ side)
            theta_o = inclination(sine)
            # more numbers than Mitsuba gives; from its own, so that threads change nothing
            rng = random.Random(repr((sample2.x, sample2.y)))
            theta, phi = lobes.draw(theta_o, sample1, rng)
            across = math.cos(phi) * side + math.sin(phi) * np.cross(axis, side)
            albedo = sum(lobes.energies(theta_o))
            found = mi.BSDFSample3f()
            found.wo = mi.Vector3f(*(math.sin(theta) * axis + math.cos(theta) * across))
            found.pdf = lobes.value(theta_o, theta, phi) / albedo
            found.eta, found.sampled_component, found.sampled_type = 1.0, 0, +mi.BSDFFlags.GlossyReflection
            return found, mi.Color3f(albedo)

    name = f"fiber_lobes_{id(lobes)}"
    mi.register_bsdf(name, FiberLobes)
    return name


def light_of_three(directions: np.ndarray) -> np.ndarray:
    """Red light from everywhere, green where z > 0 alone, blue where x > 0: shape [n, 3]."""
    return np.stack([np.ones(len(directions)), directions[:, 2] > 0, directions[:, 0] > 0], axis=1)


def light_dict(mi) -> dict:
    """`light_of_three`. Rows go from y to -y, the first half of the columns has x > 0; turned, y is z."""
    light = np.zeros((1024, 1024, 3), np.float32)
    light[..., 0] = 1
    light[:512, :, 1] = 1
    light[:, :512, 2] = 1
    turned = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    return {"type": "envmap", "bitmap": mi.Bitmap(light), "to_world": turned}


def scene_dict(mi, fibers: SplineFibers, lobes: str, view: View, file: Path) -> dict:
    """For `mi.load_dict`, in lengths of 1/PER_MM; `file` takes the curves."""
    rows = [
        "\n".join("{:.6f} {:.6f} {:.6f} {:.6f}".format(*p, fibers.radius_mm * PER_MM) for p in curve)
        for curve in fibers.control * PER_MM
    ]
    file.write_text("\n\n".join(rows) + "\n", encoding="utf-8")
    to_camera = mi.ScalarTransform4f().look_at(
        origin=[2 * PER_MM * x for x in view.toward], target=[0, 0, 0], up=[0, 1, 0]
    ) @ mi.ScalarTransform4f().scale([view.half_mm * PER_MM, view.half_mm * PER_MM, 1])
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2000, "rr_depth": 16, "hide_emitters": True},
        "light": light_dict(mi),
        "fibers": {"type": "bsplinecurve", "filename": str(file), "bsdf": {"type": lobes}},
        "sensor": {
            "type": "orthographic",
            "to_world": to_camera,
            "sampler": {"type": "independent"},
            "film": {
                "type": "hdrfilm",
                "width": view.resolution,
                "height": view.resolution,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
        },
    }


def render_fibers(
    fibers: SplineFibers,
    parameters: FiberScatteringParameters,
    view: View,
    folder: Path,
    *,
    runs: int,
) -> np.ndarray:
    """Pictures of one sample per pixel by Mitsuba's `path` (scalar_rgb), shape [runs, height, width, 3]."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    name = register_lobes(parameters)
    scene = mi.load_dict(scene_dict(mi, fibers, name, view, folder / "fibers.txt"))
    pictures = [mi.render(scene, spp=1, seed=1 + run) for run in range(runs)]
    return np.stack([np.array(picture, dtype=np.float64)[..., :3] for picture in pictures])
