"""Disney's principled BRDF in float64, from Burley's course notes, for shaders/surface/principled.glsl."""

from __future__ import annotations

import numpy as np

NAMES = (
    "subsurface",
    "metallic",
    "specular",
    "specular_tint",
    "roughness",
    "anisotropic",
    "sheen",
    "sheen_tint",
    "clearcoat",
    "clearcoat_gloss",
)


def schlick(cosine):
    return np.clip(1 - cosine, 0, 1) ** 5


def lerp(a, b, t):
    return a + (b - a) * t


def shadowing(w, ax, ay):
    return 1 / (w[..., 2] + np.sqrt((w[..., 0] * ax) ** 2 + (w[..., 1] * ay) ** 2 + w[..., 2] ** 2))


def principled(color, p, wo, wi):
    """BRDF without the cosine, shape [..., 3]; `p`: the ten numbers by name."""
    color = np.asarray(color, float)
    h = wo + wi
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    nl, nv, lh = wi[..., 2], wo[..., 2], (wi * h).sum(-1)
    luminance = color @ [0.3, 0.6, 0.1]
    tint = color / luminance
    base = lerp(p["specular"] * 0.08 * lerp(np.ones(3), tint, p["specular_tint"]), color, p["metallic"])
    fl, fv, fh = schlick(nl), schlick(nv), schlick(lh)
    fd90 = 0.5 + 2 * lh**2 * p["roughness"]
    fd = lerp(1, fd90, fl) * lerp(1, fd90, fv)
    fss90 = lh**2 * p["roughness"]
    fss = lerp(1, fss90, fl) * lerp(1, fss90, fv)
    ss = 1.25 * (fss * (1 / (nl + nv) - 0.5) + 0.5)
    aspect = np.sqrt(1 - 0.9 * p["anisotropic"])
    ax, ay = max(0.001, p["roughness"] ** 2 / aspect), max(0.001, p["roughness"] ** 2 * aspect)
    ds = 1 / (np.pi * ax * ay * ((h[..., 0] / ax) ** 2 + (h[..., 1] / ay) ** 2 + h[..., 2] ** 2) ** 2)
    fs = lerp(base, np.ones(3), fh[..., None])
    gs = shadowing(wi, ax, ay) * shadowing(wo, ax, ay)
    sheen = fh[..., None] * p["sheen"] * lerp(np.ones(3), tint, p["sheen_tint"])
    alpha = lerp(0.1, 0.001, p["clearcoat_gloss"])
    dr = (alpha**2 - 1) / (np.pi * np.log(alpha**2) * (1 + (alpha**2 - 1) * h[..., 2] ** 2))
    fr = lerp(0.04, 1, fh)
    gr = shadowing(wi, 0.25, 0.25) * shadowing(wo, 0.25, 0.25)
    diffuse = lerp(fd, ss, p["subsurface"])[..., None] * color / np.pi
    value = (diffuse + sheen) * (1 - p["metallic"]) + (gs * ds)[..., None] * fs
    value = value + (0.25 * p["clearcoat"] * gr * fr * dr)[..., None]
    return np.where(((nl > 0) & (nv > 0))[..., None], value, 0)
