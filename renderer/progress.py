"""What is said and shown of a picture while its samples are taken."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .film import Film

Progress = Callable[[float, str], None]
PROGRESS_SECONDS = 0.25
GROWTH = 1.5
"""By which the time between two looks grows: early ones change most."""
SHARE = 0.05
"""Of the time that looking may take."""


@dataclass(frozen=True)
class Watch:
    """Who wants to see the picture now and then."""

    show: Callable[[Film], None]
    first_s: float = 2.0
    """Until the first look."""


class ProgressReport:
    """Passes finished samples on to a progress callback now and then, and the picture to a watch."""

    def __init__(
        self,
        progress: Progress | None,
        total: int,
        done: int,
        *,
        watch: Watch | None = None,
        film: Callable[[], Film],
    ) -> None:
        self.progress, self.total, self.done, self.before = progress, total, done, done
        self.watch, self.film = watch, film
        self.started = self.last = time.perf_counter()
        self.pause = watch.first_s if watch else 0.0
        self.next_look = self.started + self.pause
        self.noise = ""

    def add(self, samples: int) -> None:
        """Some more samples are finished."""
        self.done += samples
        now = time.perf_counter()
        if self.watch is not None and now >= self.next_look and self.done < self.total:
            self._look(self.watch, now)
        if self.progress is None or (now - self.last < PROGRESS_SECONDS and self.done < self.total):
            return
        self.last = now
        speed = (self.done - self.before) / max(now - self.started, 1e-9) / 1e6
        left = (self.total - self.done) / max(speed * 1e6, 1e-9)
        detail = f"{self.done} of {self.total} paths, {speed:.3f} M/s, {left:.0f} s left{self.noise}"
        self.progress(self.done / self.total, detail)

    def _look(self, watch: Watch, now: float) -> None:
        film = self.film()
        noise = noise_so_far(film)
        self.noise = "" if noise is None else f", noise {noise:.1%}"
        watch.show(film)
        after = time.perf_counter()
        self.pause = max(self.pause * GROWTH, (after - now) / SHARE)
        self.next_look = after + self.pause


def noise_so_far(film: Film) -> float | None:
    """`Film.relative_error` over the pixels that have two samples or more; None where none has."""
    samples = np.broadcast_to(film.samples, film.sums.shape[1])
    enough = samples >= 2
    if not enough.any():
        return None
    part = Film(int(enough.sum()), 1, film.sums[:2, enough], samples=samples[enough])
    return part.relative_error()


def radiance_so_far(film: Film) -> np.ndarray:
    """Mean radiance, black where nothing is finished, float32, shape [height, width, 3]."""
    samples = np.maximum(np.broadcast_to(film.samples, film.sums.shape[1]), 1)
    mean = film.sums[0, :, :3] / samples[:, None]
    return mean.reshape(film.height, film.width, 3).astype(np.float32)
