"""Speed against Mitsuba 3 on one scene, in one run: paths per CPU second, and at equal variance.

Run with `make benchmark`. It prints ratios and asserts nothing about them.
"""

from __future__ import annotations

import pytest

from tests.peers.mitsuba_volume import PeerImage, render_with_mitsuba
from tests.peers.scenes import twisted_yarns
from tests.peers.weft_volume import render_with_weft


@pytest.mark.benchmark
@pytest.mark.parametrize("voxels", [128, 256])
def test_paths_per_cpu_second(voxels: int) -> None:
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    # the same optical depth per yarn whatever the resolution
    scene = twisted_yarns(voxels, peak_extinction=60.0, resolution=128)
    render_with_weft(scene, samples=1, seed=0)  # compile the kernel once
    weft = render_with_weft(scene, samples=64, seed=1)
    mitsuba = render_with_mitsuba(scene, samples_per_run=2, runs=4, seed=2)
    speed = _speed(weft) / _speed(mitsuba)
    equal_variance = speed * _variance(mitsuba) / _variance(weft)
    print(
        f"\n{voxels}^3 voxels, {scene.resolution}^2 pixels, isotropic phase function, paths per CPU second:"
    )
    print(f"  weft    {_speed(weft):12,.0f}   mean {weft.mean.mean():.4f}")
    print(f"  Mitsuba {_speed(mitsuba):12,.0f}   mean {mitsuba.mean.mean():.4f}   (scalar_rgb)")
    print(f"  ratio   {speed:.1f} in paths, {equal_variance:.1f} at equal variance")


def _speed(image: PeerImage) -> float:
    return image.paths / image.cpu_seconds


def _variance(image: PeerImage) -> float:
    """Variance of one path per pixel, averaged over the picture."""
    return image.variance.mean() * image.paths / image.mean.size
