"""Yarns and presets to grow fibers on."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.yarns.yarns import YarnSet

PRESETS = Path(__file__).resolve().parents[2] / "configs" / "presets" / "fibers"


@pytest.fixture(scope="session")
def fiber_config() -> Callable[..., FibersConfig]:
    """A preset's settings, with other values on top."""

    def load(preset: str, **values: object) -> FibersConfig:
        table = tomllib.loads((PRESETS / f"{preset}.toml").read_text(encoding="utf-8"))
        return FibersConfig(preset=preset, **{**table, **values})

    return load


@pytest.fixture(scope="session")
def straight_yarn() -> Callable[..., YarnSet]:
    """One straight yarn along x, or several side by side."""

    def make(length: float, radius: float = 1.0, count: int = 1) -> YarnSet:
        x = np.linspace(0.0, length, 11)
        points = [np.stack([x, np.full(11, 3.0 * radius * yarn), 0 * x], axis=1) for yarn in range(count)]
        return YarnSet(
            points=np.concatenate([np.empty((0, 3)), *points]),
            offsets=np.arange(count + 1) * 11,
            closed=np.zeros(count, dtype=bool),
            radius=np.full(count, radius),
            yarn_type=np.zeros(count, dtype=np.int32),
        )

    return make


@pytest.fixture(scope="session")
def yarn_loop() -> Callable[..., YarnSet]:
    """A closed yarn that is not planar."""

    def make(size: float, radius: float = 1.0, *, wave: float = 0.3) -> YarnSet:
        t = np.arange(32) * 2 * np.pi / 32
        points = size * np.stack([np.cos(t), np.sin(t), wave * np.sin(2 * t)], axis=1)
        return YarnSet(
            points=points,
            offsets=np.array([0, 32]),
            closed=np.array([True]),
            radius=np.array([radius]),
            yarn_type=np.zeros(1, dtype=np.int32),
        )

    return make
