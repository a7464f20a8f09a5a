"""What happens to light at the fiber's surface, as Warp functions: smooth (Fresnel) or rough (GGX).

Local frame: z is the normal on the side of the medium that the light travels in, x lies along the fiber.

The rough surface is a Smith microsurface with GGX slopes (Walter et al. 2007) and all its bounces: light
walks on it as in Heitz et al. 2016, "Multiple-scattering microfacet BSDFs with the Smith model", until it
leaves, here with a fresh height at every bounce. It leaves upward with probability G1 = 1 / (1 + Lambda);
else it meets a visible normal again. A walk over the directions d then has the density
Π D(m) <d, m> / Π sigma(d), sigma(d) = |cos| (1 + Lambda): the same backward, so it is reciprocal; and nothing
is lost, so it keeps energy.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

ZERO = wp.constant(wp.float64(0.0))
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
TWO_PI = wp.constant(wp.float64(6.283185307179586))


@wp.func
def fresnel(cosine: wp.float64, eta: wp.float64) -> wp.float64:
    """Twin: `dielectric.fresnel`; `cosine` is not negative."""
    square = ONE - (ONE - cosine * cosine) / (eta * eta)
    reflectance = ONE
    if square > ZERO:
        inside = wp.sqrt(square)
        across = (cosine - eta * inside) / (cosine + eta * inside)
        along = (eta * cosine - inside) / (eta * cosine + inside)
        reflectance = HALF * (across * across + along * along)
    return reflectance


@wp.func
def reflect(view: wp.vec3d, normal: wp.vec3d) -> wp.vec3d:
    """Direction of travel after the reflection of light that came from `view`."""
    return TWO * wp.dot(view, normal) * normal - view


@wp.func
def refract(view: wp.vec3d, normal: wp.vec3d, eta: wp.float64) -> wp.vec3d:
    """Direction of travel in a medium `eta` times as dense; not for total reflection."""
    cosine = wp.dot(view, normal)
    square = wp.max(ONE - (ONE - cosine * cosine) / (eta * eta), ZERO)
    return (cosine / eta - wp.sqrt(square)) * normal - view / eta


@wp.func
def visible_normal(view: wp.vec3d, alpha: wp.float64, u: wp.float64, v: wp.float64) -> wp.vec3d:
    """A normal with density D(m) <view, m> / sigma(view), after Dupuy and Benyoub 2023 (spherical caps).

    `view` may come from below: what a ray that travels up through the microsurface meets.
    """
    wide = wp.normalize(wp.vec3d(alpha * view[0], alpha * view[1], view[2]))
    z = (ONE - v) * (ONE + wide[2]) - wide[2]
    radius = wp.sqrt(wp.max(ONE - z * z, ZERO))
    turn = TWO_PI * u
    half = wp.vec3d(
        radius * wp.cos(turn) + wide[0], radius * wp.sin(turn) + wide[1], wp.max(z + wide[2], ZERO)
    )
    return wp.normalize(wp.vec3d(alpha * half[0], alpha * half[1], half[2]))


@wp.func
def escape_probability(direction: wp.vec3d, alpha: wp.float64) -> wp.float64:
    """Smith's G1 of a direction of travel above the surface; 0 for one that points into it."""
    probability = ZERO
    if direction[2] > ZERO:
        slope = (direction[0] * direction[0] + direction[1] * direction[1]) / (direction[2] * direction[2])
        probability = TWO / (ONE + wp.sqrt(ONE + alpha * alpha * slope))
    return probability
