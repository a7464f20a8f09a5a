"""Path tracing where the device holds a part of the voxels only: the same samples, in another order.

The screen is traced in strips, each strip's bricks loaded before it starts. Paths that need other bricks are
set aside with their state and go on when these are there: with the strips that come, and then in sweeps that
load what is wanted (sweeps.py). Every sample is recorded apart and they are added in order (sample_fold.py),
so that no sample waits for another and the picture has the bits that it has in core.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from .batches import SMALLEST_HEIGHT
from .gpu import buffers
from .gpu.programs import set_uniforms
from .kernel import BUSY_LANES, WAITING_LANES, Kernel, KernelOptions
from .pager import BrickPager, pool_capacity
from .passes import (
    MODE_DONE,
    MODE_IDLE,
    MODE_PARKED,
    NO_PIXEL,
    Aside,
    Pass,
    PassState,
    pixel_order,
    window_ranges,
)
from .residency import NO_BRICK
from .sample_fold import Records, SampleFold
from .scene import Scene
from .waiting import ANY_CELL, MODE_BITS, SLOT_SHIFT, Paths, WaitingPaths, join_paths

CHUNK_BYTES = 1 << 26
"""Of the film on the device, at most."""
SUMS_BYTES = 1 << 29
"""Of the sums of a pass, which are on the host, at most."""
NO_SAMPLE = -1
PARKED_SHARE = 1 / 16
"""Of the lanes: when so many wait, they make room for other samples."""
LOST_SHARE = 1 / 8
"""Of the lanes at work: so many should be idle or wait at the end of a dispatch, or else it is too long."""
FEW_LANES = 64
"""Too few for their loss to matter."""
RIM_PATHS = 3
"""That wait for a cell near a strip, seen by a strip before: it is loaded again, along with this one."""
RUNNING_SHARE = 0.7
"""Of the lanes: when fewer run, and no sample is left to begin, the rest is taken along to the next chunk."""


def build_kernel(context: moderngl.Context, scene: Scene, options: KernelOptions) -> Kernel:
    """The one that the scene needs."""
    return (
        Kernel(context, scene, options)
        if pool_capacity(scene) is None
        else OutOfCoreKernel(context, scene, options)
    )


@dataclass
class Chunk:
    """Samples of one strip, each begun once, and guests: paths of other strips that go on."""

    work: Pass
    guests: Paths
    first: int
    """Of the samples: those before were begun earlier, by a run that was stopped."""
    lanes: int
    """That were given work when it began."""

    @property
    def own_count(self) -> int:
        return self.work.pixel_count * len(self.work.samples)


class OutOfCoreKernel(Kernel):
    """As `Kernel`, with the bricks of a pool."""

    pager: BrickPager
    passed: np.ndarray
    """Which cells strips have seen, this one too, bool, shape [cell_count]."""
    at_work: int
    """Lanes that have something to do when the next dispatch begins."""

    @property
    def film_bytes(self) -> int:
        """Room for the sums of a pass, which are on the host."""
        return SUMS_BYTES

    def begin(self, work: Pass, sums: np.ndarray | None = None) -> None:
        """Start a pass; `sums` as in core."""
        size = self.scene.config.block_samples
        self._open(work, SampleFold(self._empty_sums(work, sums), work.samples, size))
        self._next_chunk()

    def restore(self, state: PassState) -> bool:
        """Go on with a pass that was begun; false where it ran in core, or with a pool of another size."""
        aside, words = state.aside, self.state_words
        if aside is None or aside.capacity != self.pager.capacity or state.lanes.shape[0] != words:
            return False
        fold = SampleFold(state.sums, state.work.samples, self.scene.config.block_samples)
        fold.next = aside.next.copy()
        if len(aside.loose):
            fold.loose = [Records(aside.loose[:, 0], aside.loose[:, 1], aside.loose_film)]
        self._open(state.work, fold)
        rows = np.ascontiguousarray(state.lanes.transpose(1, 0, 2))
        self._put_aside(self._as_paths(rows, aside.film))
        self.strip, self.first_sample, self.last_sample = aside.strip, aside.first_sample, aside.last_sample
        for strip in self.strips[: self.strip + 1]:
            self.passed[strip.cells] = True
        if 0 <= self.strip < len(self.strips):
            self._load(self.strips[self.strip].cells)
        self.begun = state.taken
        self._next_chunk()
        return True

    def sums(self) -> np.ndarray:
        """Film sums so far of each block of the pass, float32, [block_count, layer_count, pixel_count, 4]."""
        self.fold.flush()
        return self.fold.sums()

    def state(self) -> PassState:
        """All that continues the pass bit by bit, with any number of lanes."""
        fold = self.fold.copy()
        paths = join_paths(self.paths.all(), self._harvest(fold))
        fold.flush()
        places = [np.stack([part.places, part.samples], axis=-1) for part in fold.loose]
        films = [part.values for part in fold.loose]
        samples = range(self.first_sample, self.last_sample)
        if self.chunk.own_count:
            samples = self.chunk.work.samples
        aside = Aside(
            capacity=self.pager.capacity,
            strip=self.strip,
            first_sample=samples.start,
            last_sample=samples.stop,
            film=paths.film,
            next=fold.next,
            loose=np.concatenate([np.zeros((0, 2), np.int64), *places]),
            loose_film=np.concatenate([np.zeros((0, self._record_width), np.float32), *films]),
        )
        rows = np.ascontiguousarray(paths.rows.transpose(1, 0, 2))
        taken = self._taken() if self.chunk.own_count else self.begun
        return PassState(self.work, fold.sums(), rows, taken, self._image_width, aside)

    def advance(self) -> int:
        """One dispatch and what follows from it; the number of samples it finished."""
        values = self._dispatch()
        own, waiting = self.chunk.own_count, int(values[WAITING_LANES])
        running = int(values[BUSY_LANES]) - waiting
        self.counts.waiting_lanes += waiting
        if self.at_work > FEW_LANES:
            lost = 1 - running / self.at_work
            self._adapt(min(LOST_SHARE / max(lost, 1e-6), 1.0))
        self.at_work = self.lane_count if values[0] < own else running
        if values[0] < own:
            if waiting > PARKED_SHARE * self.lane_count:
                self._make_room()
        elif running == 0 or (self.pager.exact and running <= RUNNING_SHARE * self.chunk.lanes):
            self._put_aside(self._harvest(self.fold))
            self._next_chunk()
        return int(values[3])

    def _open(self, work: Pass, fold: SampleFold) -> None:
        self.work, self.fold = work, fold
        self.strips, self.sweeps = self.pager.plan(*window_ranges(work.window))
        self.paths = WaitingPaths(self.state_words, self.scene.film_layers)
        self.strip, self.first_sample, self.begun, self.busy = -1, work.samples.stop, 0, True
        self.last_sample, self.resident = NO_SAMPLE, self.pager.resident()
        self.passed = np.zeros(len(self.resident), bool)

    def _next_chunk(self) -> None:
        """Load bricks until there is something to do, and begin it."""
        while True:
            ready = self.paths.ready_count
            if ready > self.lane_count or (ready and self.strip == len(self.strips)):
                self._start_chunk(Pass((0, 0, 0, 0), range(0)))
                return
            if self.first_sample < self.work.samples.stop:
                self._start_chunk(self._strip_samples())
                return
            if not self._move_on():
                self.busy = False
                return

    def _move_on(self) -> bool:
        """Load the next strip's bricks, or what the next paths want; false where nothing is left to do."""
        if self.strip < len(self.strips):
            self.strip += 1
        if self.strip < len(self.strips):
            strip = self.strips[self.strip]
            wanted = self.paths.wanted(RIM_PATHS)
            rim = self.pager.rim(strip, wanted[self.passed[wanted]])
            self._load(np.concatenate([strip.cells, rim]))
            self.passed[strip.cells] = True
            self.first_sample = self.work.samples.start
            return True
        wanted = self.paths.wanted()
        if len(wanted):  # else those left were only taken off their lanes
            self._load(self.sweeps.next_cells(wanted))
        return bool(len(self.paths))

    def _load(self, cells: np.ndarray) -> None:
        self.pager.load(cells)
        self.resident = self.pager.resident()
        self.paths.look_again(self.resident)
        self.counts.brick_uploads, self.counts.bricks_used = self.pager.uploads, self.pager.bricks_used

    def _strip_samples(self) -> Pass:
        """As many of the strip's samples as the film has room for."""
        batch = self.strips[self.strip]
        window = batch.columns.start, batch.rows.start, len(batch.columns), len(batch.rows)
        assert self.film is not None
        places = self.film.size // (self._record_width * 4) - self.lane_count
        start, stop = self.first_sample, self.last_sample
        if stop == NO_SAMPLE:
            stop = min(start + max(places // (window[2] * window[3]), 1), self.work.samples.stop)
        self.first_sample, self.last_sample = stop, NO_SAMPLE
        return Pass(window, range(start, stop))

    def _start_chunk(self, work: Pass) -> None:
        guests = self.paths.take(self.lane_count)
        own = work.pixel_count * len(work.samples)
        begun = self.begun if own else 0
        self.begun -= begun
        lanes = min(self.lane_count, own - begun + len(guests))
        self.chunk = Chunk(work, guests, begun, lanes)
        self.aside: list[np.ndarray] = []
        self.at_work = lanes
        guests.rows[:, 5, 3] &= MODE_BITS
        guests.rows[:, 5, 3] |= np.arange(own, own + len(guests), dtype=np.uint32) << SLOT_SHIFT
        states = self._idle_states()
        states[:, : len(guests)] = guests.rows.transpose(1, 0, 2)
        film = np.zeros((self.scene.film_layers, own + len(guests), 4), np.float32)
        film[:, own:] = guests.film.reshape(len(guests), self.scene.film_layers, 4).transpose(1, 0, 2)
        self._fill_film(film)
        self._fill_lanes(states, begun)
        self._set_work(work, 1)
        set_uniforms(self.program, {"film_slots": max(film.shape[1], 1)})

    def _reserve_film(self) -> None:
        """Room for single samples and guests, or for as many as the device can hold."""
        _, _, width, height = self.scene.config.window
        least = (self.lane_count + width * SMALLEST_HEIGHT) * self._record_width * 4
        most = least + width * height * self.scene.config.samples_per_pixel * self._record_width * 4
        wished = max(min(most, CHUNK_BYTES), least)
        while self.film is None:
            try:
                self.film = buffers.reserve(self.context, wished, name="the samples of the picture")
            except buffers.BufferRefused:
                if wished == least:
                    raise
                wished = max(wished // 2, least)

    def _make_room(self) -> None:
        """Set the paths that wait aside, so that their lanes begin other samples."""
        lanes = self._lanes()
        parked = lanes[5, :, 3] & MODE_PARKED != 0
        self.aside.append(np.ascontiguousarray(lanes[:, parked].transpose(1, 0, 2)))
        lanes[:, parked] = self._idle_states()[:, :1]
        self.states.write(lanes)

    def _harvest(self, fold: SampleFold) -> Paths:
        """Add what the chunk has finished; all that it has not."""
        lanes = self._lanes()
        mode = lanes[5, :, 3] & (MODE_BITS | MODE_PARKED)
        idle = (lanes[8, :, 0] == NO_PIXEL) | (mode == MODE_DONE) | (mode == MODE_IDLE)
        rows = np.concatenate([*self.aside, lanes[:, ~idle].transpose(1, 0, 2)])
        slots = rows[:, 5, 3] >> SLOT_SHIFT
        own, count = self.chunk.own_count, self.chunk.own_count + len(self.chunk.guests)
        size = self.scene.film_layers * count * 16
        assert self.film is not None
        film = np.frombuffer(self.film.read(size=size), np.float32) if size else np.zeros(0, np.float32)
        film = film.reshape(self.scene.film_layers, count, 4).transpose(1, 0, 2)
        finished = np.ones(count, bool)
        finished[: self.chunk.first], finished[self._taken() : own], finished[slots] = False, False, False
        places, samples = self._keys()
        fold.add(Records(places[finished], samples[finished], film[finished].reshape(-1, self._record_width)))
        return self._as_paths(rows, film[slots].reshape(-1, self._record_width))

    def _keys(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixel within the pass and sample of each place of the chunk's film."""
        work, guests = self.chunk.work, self.chunk.guests
        left, top, width, _ = work.window
        order = pixel_order(work) if work.pixel_count else np.zeros(0, np.int64)
        row, column = np.divmod(order, max(width, 1))
        pixels = np.tile((row + top) * self._image_width + column + left, len(work.samples))
        samples = np.repeat(np.arange(work.samples.start, work.samples.stop), work.pixel_count)
        row, column = np.divmod(np.concatenate([pixels, guests.pixels]), self._image_width)
        left, top, width, _ = self.work.window
        return (row - top) * width + column - left, np.concatenate([samples, guests.samples])

    def _put_aside(self, paths: Paths) -> None:
        self.paths.add(paths, (paths.cells == ANY_CELL) | self.resident[paths.cells])

    def _as_paths(self, rows: np.ndarray, film: np.ndarray) -> Paths:
        """Paths from their rows: those that wait, and those that were running."""
        parked = rows[:, 5, 3] & MODE_PARKED != 0
        return Paths(
            rows, film, self.pager.cells_wanted(np.where(parked, rows[:, 8, 3], np.uint32(NO_BRICK)))
        )

    def _lanes(self) -> np.ndarray:
        return buffers.read(self.states, np.uint32).reshape(self.state_words, self.lane_count, 4).copy()

    def _taken(self) -> int:
        """Samples of the chunk that are begun."""
        return min(int(buffers.read(self.counters, np.uint32)[0]), self.chunk.own_count)

    @property
    def _record_width(self) -> int:
        return self.scene.film_layers * 4
