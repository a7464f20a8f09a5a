"""BRDFs of the RGL material database (Dupuy and Jakob 2018), tensor files named .bsdf.

Reflectance stands on a grid that is warped, for each direction of the light, by the density of visible
microfacet normals. With u = sqrt(2 theta / pi) and v = (phi + pi) / 2 pi of the half vector, and the
uniform point (s, t) that the warp takes to (u, v): f = spectra(s, t) ndf(u, v) / (4 sigma(light)). As
powitacq.inl (rgl-epfl/brdf-loader) evaluates it, in float64. Read: spectral and RGB files, isotropic and
anisotropic over the full circle; files that state half or a quarter of it are refused, as in powitacq.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from weft.files.errors import InputError

from .tensor_file import read_tensor_file, write_tensor_file
from .warp_table import Array, Corners, WarpTable, bilinear, cell, corners

REQUIRED = {"theta_i": 1, "phi_i": 1, "ndf": 2, "sigma": 2, "vndf": 4}
"""Fields of float32 and their numbers of dimensions; besides, `spectra` (5) with `wavelengths`, or `rgb`."""


@dataclass(frozen=True)
class RglBrdf:
    """The fields of a file, and the BRDF they stand for."""

    fields: Mapping[str, NDArray]

    @property
    def channels(self) -> tuple[str, ...]:
        if "rgb" in self.fields:
            return ("r", "g", "b")
        return tuple(f"{length:g}nm" for length in self.fields["wavelengths"].tolist())

    @property
    def isotropic(self) -> bool:
        """One or two azimuths of the light: then the half vector's azimuth counts from the light's."""
        return len(self.fields["phi_i"]) <= 2

    @cached_property
    def _visible(self) -> WarpTable:
        vndf = self.fields["vndf"].astype(np.float64)
        return WarpTable.of(vndf.reshape(-1, *vndf.shape[2:]))

    @cached_property
    def _reflectance(self) -> Array:
        """Shape [slices, rows, columns, channels]."""
        table = self.fields["rgb" if "rgb" in self.fields else "spectra"].astype(np.float64)
        return np.moveaxis(table.reshape(-1, *table.shape[2:]), 1, -1)

    def evaluate(self, light: Array, detector: Array) -> Array:
        """BRDF [1/sr], shape [N, channels], of unit vectors of shape [N, 3]; 0 below the surface."""
        half = light + detector
        half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-300)
        theta_i, phi_i = _angles(light)
        theta_m, phi_m = _angles(half)
        u, v = _to_square(theta_m, phi_m - phi_i if self.isotropic else phi_m)
        v = v - np.floor(v)
        nodes = tuple(self.fields[name].astype(np.float64) for name in ("phi_i", "theta_i"))
        at = corners((nodes[0], nodes[1]), (phi_i, theta_i))
        found = self._interpolated(*self._visible.unwarp(u, v, at), at)
        found *= (bilinear(self._grid("ndf"), u, v) / (4.0 * self._area(theta_i, phi_i)))[:, None]
        return np.where(((light[:, 2] > 0) & (detector[:, 2] > 0))[:, None], found, 0.0)

    def _interpolated(self, s: Array, t: Array, at: Corners) -> Array:
        table = self._reflectance
        (column, fx), (row, fy) = cell(s, table.shape[2]), cell(t, table.shape[1])
        fx, fy = fx[:, None], fy[:, None]
        low, high = (
            (1 - fx) * at.mix(table, r, column) + fx * at.mix(table, r, column + 1) for r in (row, row + 1)
        )
        return (1 - fy) * low + fy * high

    def _grid(self, name: str) -> Array:
        return self.fields[name].astype(np.float64)

    def _area(self, theta_i: Array, phi_i: Array) -> Array:
        """Projected area of the microfacets seen from the light."""
        return bilinear(self._grid("sigma"), *_to_square(theta_i, phi_i))

    def measured(self) -> tuple[Array, Array, Array]:
        """Light and detector, each of shape [N, 3], and the BRDF there, shape [N, channels].

        Where the instrument measured: the points of the warped grid, of all directions of the light. Left
        out is what points below the surface.
        """
        parts = []
        for index in range(len(self._reflectance)):
            p, t = divmod(index, len(self.fields["theta_i"]))
            theta_i = np.array([float(self.fields["theta_i"][t])])
            phi_i = np.array([float(self.fields["phi_i"][p])])
            reflectance = self._reflectance[index]
            u, v = (x.ravel() for x in self._visible.warp_grid(index, *reflectance.shape[:2]))
            azimuth = (2 * v - 1) * np.pi + (phi_i if self.isotropic else 0.0)
            half, light = _vectors(u**2 * (np.pi / 2), azimuth), _vectors(theta_i, phi_i)
            detector = 2.0 * (half @ light.T) * half - light
            factor = bilinear(self._grid("ndf"), u, v) / (4.0 * self._area(theta_i, phi_i))
            brdf = reflectance.reshape(len(u), -1) * factor[:, None]
            above = (detector[:, 2] > 0) & (light[0, 2] > 0)
            parts.append((np.repeat(light, len(u), axis=0)[above], detector[above], brdf[above]))
        lights, detectors, brdfs = zip(*parts, strict=True)
        return np.concatenate(lights), np.concatenate(detectors), np.concatenate(brdfs)


def _angles(directions: Array) -> tuple[Array, Array]:
    x, y, z = directions.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _vectors(theta: Array, phi: Array) -> Array:
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def _to_square(theta: Array, phi: Array) -> tuple[Array, Array]:
    return np.sqrt(theta * (2 / np.pi)), (phi + np.pi) / (2 * np.pi)


def read_rgl(path: str | Path) -> RglBrdf:
    """Read a .bsdf file. Raises `InputError` that names the field that is missing or wrong."""
    path = Path(path)
    fields = read_tensor_file(path)
    colors = "rgb" if "rgb" in fields else "spectra"
    dimensions = REQUIRED | {colors: 5} | ({} if colors == "rgb" else {"wavelengths": 1})
    for name, count in dimensions.items():
        _check_field(fields, name, count, path)
    _check_shapes(fields, colors, path)
    _check_values(fields, path)
    return RglBrdf(fields)


def write_rgl(brdf: RglBrdf, path: str | Path) -> None:
    """Write all fields, also those not used here; what `read_rgl` read comes back bit for bit."""
    write_tensor_file(brdf.fields, path)


def _check_field(fields: Mapping[str, NDArray], name: str, dimensions: int, path: Path) -> None:
    if name not in fields:
        raise InputError(f"no field '{name}'; not a BRDF of the RGL database", path=path)
    field = fields[name]
    what = ""
    if field.dtype != np.float32 or field.ndim != dimensions or 0 in field.shape:
        what = f"need float32 in {dimensions} dimensions, found {field.dtype} {list(field.shape)}"
    elif dimensions > 1 and min(field.shape[-2:]) < 2:
        what = f"a grid of {list(field.shape[-2:])} points; need at least 2 x 2"
    elif not np.isfinite(field).all():
        what = "found a number that is not finite"
    if what:
        raise InputError(f"field '{name}': {what}", path=path)


def _check_shapes(fields: Mapping[str, NDArray], colors: str, path: Path) -> None:
    """One slice for each direction of the light, one channel for each wavelength."""
    slices = (len(fields["phi_i"]), len(fields["theta_i"]))
    for name in ("vndf", colors):
        if fields[name].shape[:2] != slices:
            what = f"field '{name}' has {fields[name].shape[:2]} slices, phi_i and theta_i {slices}"
            raise InputError(what, path=path)
    channels = 3 if colors == "rgb" else len(fields["wavelengths"])
    if fields[colors].shape[2] != channels:
        what = f"field '{colors}' has {fields[colors].shape[2]} channels; need {channels}"
        raise InputError(what, path=path)
    phi_i = fields["phi_i"].astype(np.float64)
    if slices[0] > 2 and abs(phi_i[-1] - phi_i[0] - 2 * np.pi) > 1.0:
        what = "the light's azimuths do not go full circle; files reduced by symmetry cannot be read"
        raise InputError(f"field 'phi_i': {what}", path=path)


def _check_values(fields: Mapping[str, NDArray], path: Path) -> None:
    for name, most in (("theta_i", np.pi / 2), ("phi_i", np.pi)):
        angles = fields[name].astype(np.float64)
        if (np.diff(angles) <= 0).any() or np.abs(angles).max() > most + 1e-3:
            raise InputError(f"field '{name}': need ascending angles up to {most:.4g} radians", path=path)
    vndf = fields["vndf"].astype(np.float64)
    if (vndf < 0).any() or (vndf.sum(axis=(2, 3)) <= 0).any():
        raise InputError("field 'vndf': need densities of at least 0 that are not all 0", path=path)
    if (fields["sigma"] <= 0).any() or (fields["ndf"] < 0).any():
        raise InputError(
            "fields 'sigma' and 'ndf': need areas above 0 and densities of at least 0", path=path
        )
    names = [f"{length:g}" for length in fields.get("wavelengths", np.zeros(0)).tolist()]
    if len(set(names)) < len(names) or any(float(name) <= 0 for name in names):
        raise InputError("field 'wavelengths': need different ones above 0", path=path)
