"""Running shaders/path/trace.comp: buffers, bindings, and bounded dispatches until every sample is done."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import moderngl
import numpy as np

from weft.files.errors import DeviceMemoryError

from .gpu import buffers
from .gpu.device_memory import is_software
from .gpu.programs import compute_program, set_uniforms
from .heartbeat import dispatch_share, dispatching
from .pager import BrickPager, pool_capacity
from .passes import MODE_IDLE, Pass, PassState
from .scene import Scene
from .trackers import control_sixteenths
from .voxel_pages import brick_records, bricks_per_page, page_limit, voxel_pages_glsl

GROUP_SIZE = 64
STATE_WORDS = 9
"""Rows of four words per path; one more in scenes with surfaces."""
CORRELATION_WORDS = 3
"""Rows more where fibers are correlated (shaders/path/state.glsl)."""
COLOR_WORDS = 1
"""Row more where extinction depends on color."""
COUNTERS = (
    "pixel",
    "steps",
    "scattering_events",
    "samples",
    "cut_paths",
    "broken_samples",
    "majorant_violations",
)
BUSY_LANES, WAITING_LANES = len(COUNTERS), len(COUNTERS) + 1
"""Where the kernel counts lanes that are not done, and those of them that wait for a brick."""
VOXELS, PATHS = "the voxels", "the paths under way"
"""What an error calls these buffers."""
LOOP_BUDGET = 16_384
"""Iterations of all loops per invocation and dispatch; llvmpipe silently stops a shader's loops at 65,535."""
FILM_BYTES = 1 << 27
"""Of the sums on the device, at most: the smallest storage block that OpenGL 4.3 guarantees."""
SLOWEST_SAMPLING_LOOP = 8
"""Iterations of the phase function's rejection loop that the budget allows for, per round, on average."""


@dataclass(frozen=True)
class KernelOptions:
    """How the work is cut up. No choice here changes a bit of the picture."""

    lane_count: int | None = None
    """Paths in flight; unset: by the kind of device."""
    steps_per_round: int = 24
    """Tracking steps between two costly events."""
    seeks_per_round: int = 32
    """Nodes of the surfaces' hierarchy looked at between two costly events."""
    rounds_per_dispatch: int | None = None
    """At most what the loop budget allows; unset: adapted so that a dispatch takes `dispatch_seconds`."""
    dispatch_seconds: float = 0.15
    rows_per_pass: int | None = None
    """Rows of the picture whose sums are on the device at once; unset: about a million pixels."""
    blocks_per_pass: int | None = None
    """Blocks of samples that are done together; unset: as many as there is room for."""


@dataclass
class Counts:
    """What the kernel counted, over the whole picture."""

    steps: int = 0
    scattering_events: int = 0
    samples: int = 0
    cut_paths: int = 0
    broken_samples: int = 0
    majorant_violations: int = 0
    waiting_lanes: int = 0
    """Lanes that waited for a brick at the end of a dispatch, over all dispatches."""
    brick_uploads: int = 0
    """Bricks loaded into the device's pool, where that is smaller than the volume."""
    bricks_used: int = 0
    """Different bricks among them."""
    dispatches: int = 0
    longest_dispatch_seconds: float = 0.0


@dataclass
class Kernel:
    """The compiled path tracer with one scene on the device."""

    context: moderngl.Context
    scene: Scene
    options: KernelOptions
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        self.lane_count = self.options.lane_count or default_lane_count(self.context)
        self.lane_count = -(-self.lane_count // GROUP_SIZE) * GROUP_SIZE
        self.rounds = min(self.options.rounds_per_dispatch or 4, self.most_rounds)
        self.lights, self.media = self._upload_lights(), self._upload_media()
        self.film: moderngl.Buffer | None = None
        self._reserve_states()
        self._reserve_film()
        self.work = Pass((0, 0, 0, 0), range(0))
        self.busy = False
        self._upload()
        self.program = self._compile()
        set_uniforms(self.program, self.scene.uniforms() | {"lane_count": self.lane_count})

    def change(self, scene: Scene) -> None:
        """Another camera, size, light or scattering of the same volume; compiles anew only other code."""
        before, self.scene = self.scene, scene
        if self.pager is not None:
            self.pager.change(scene)
        if scene.light_table is not before.light_table:
            self.lights.release()
            self.lights = self._upload_lights()
        if scene.phase is not before.phase:
            self.media.release()
            self.media = self._upload_media()
        if (scene.surfaces is None) != (before.surfaces is None):
            self.states.release()
            self._reserve_states()
        if (scene.constants(), scene.pieces()) != (before.constants(), before.pieces()):
            self.program.release()
            self.program = self._compile()
        set_uniforms(self.program, scene.uniforms() | {"lane_count": self.lane_count})

    def trace(self, work: Pass, *, tick: Callable[[int], None] | None = None) -> np.ndarray:
        """Film sums of a pass from its beginning to its end; see `sums`.

        `tick` is called after each dispatch with the number of samples finished since the last call.
        """
        self.begin(work)
        while self.busy:
            finished = self.advance()
            if tick:
                tick(finished)
        return self.sums()

    def begin(self, work: Pass, sums: np.ndarray | None = None) -> None:
        """Start a pass; `sums`: of earlier samples of its first block, [layer_count, pixel_count, 4]."""
        film = self._empty_sums(work, sums)
        self._start(PassState(work, film, self._idle_states(), 0, self._image_width))

    def restore(self, state: PassState) -> bool:
        """Go on with a pass that was begun; false where it ran with other lanes than there are here."""
        if state.aside is not None or state.lanes.shape != (self.state_words, self.lane_count, 4):
            return False
        self._start(state)
        return True

    def sums(self) -> np.ndarray:
        """Film sums so far of each block of the pass, float32, [block_count, layer_count, pixel_count, 4]."""
        assert self.film is not None
        shape = (self._block_count(self.work), self.scene.film_layers, self.work.pixel_count, 4)
        return buffers.read(self.film, np.float32, byte_count=4 * math.prod(shape)).reshape(shape)

    def state(self) -> PassState:
        """All that continues the pass bit by bit, also in another process on the same device."""
        lanes = buffers.read(self.states, np.uint32).reshape(self.state_words, self.lane_count, 4)
        taken = int(buffers.read(self.counters, np.uint32)[0])
        return PassState(self.work, self.sums(), lanes, taken, self._image_width)

    def _empty_sums(self, work: Pass, sums: np.ndarray | None) -> np.ndarray:
        """Those that a pass begins with."""
        film = np.zeros((self._block_count(work), self.scene.film_layers, work.pixel_count, 4), np.float32)
        if sums is not None:
            film[0] = sums
        return film

    @property
    def _image_width(self) -> int:
        return self.scene.config.resolution[0]

    def _block_count(self, work: Pass) -> int:
        return len(work.blocks(self.scene.config.block_samples))

    def _start(self, state: PassState) -> None:
        self.work = state.work
        self._fill_film(state.sums)
        self._fill_lanes(state.lanes, state.taken)
        self._set_work(state.work, self.scene.config.block_samples)
        self.busy = True

    def _fill_lanes(self, lanes: np.ndarray, taken: int) -> None:
        self.states.write(np.ascontiguousarray(lanes))
        self.counters.write(np.array([taken, *[0] * WAITING_LANES], np.uint32))

    def _set_work(self, work: Pass, block_samples: int) -> None:
        self._bind()
        blocks = work.blocks(block_samples)
        left, top, width, height = work.window
        set_uniforms(
            self.program,
            {
                "first_column": left,
                "column_count": width,
                "first_row": top,
                "row_count": height,
                "sample_begin": work.samples.start,
                "sample_end": work.samples.stop,
                "block_shift": block_samples.bit_length() - 1,
                "first_block": blocks.start,
                "block_count": len(blocks),
            },
        )

    @property
    def film_bytes(self) -> int:
        """Room for the sums of a pass."""
        assert self.film is not None
        return self.film.size

    def _reserve_film(self) -> None:
        """Room for the whole picture, within `FILM_BYTES`, or for as much of it as the device can hold."""
        _, _, width, height = self.scene.config.window
        row = self.scene.film_layers * 16 * width
        blocks = -(-self.scene.config.samples_per_pixel // self.scene.config.block_samples)
        wished = max(min(row * height * blocks, FILM_BYTES), row)
        while self.film is None:
            try:
                self.film = buffers.reserve(self.context, wished, name="the sums of the picture")
            except buffers.BufferRefused:
                if wished == row:
                    raise
                wished = max(wished // 2, row)

    def _fill_film(self, sums: np.ndarray) -> None:
        if self.film is None or self.film.size < sums.nbytes:
            if self.film is not None:
                self.film.release()
                self.film = None
            self.film = buffers.reserve(self.context, sums.nbytes, name="the sums of the picture")
        self.film.write(np.ascontiguousarray(sums))

    def advance(self) -> int:
        """One dispatch; the number of samples it finished. `busy` says whether the pass needs another."""
        values = self._dispatch()
        self.busy = bool(values[BUSY_LANES])
        return int(values[3])

    def _dispatch(self) -> np.ndarray:
        """The counters after it."""
        if not self.compiled:
            self._let_the_driver_compile()
        started = time.perf_counter()
        with dispatching(software=is_software(self.context)):
            self.program["round_count"] = self.rounds
            self.program.run(self.lane_count // GROUP_SIZE)
            self.context.memory_barrier()
            values = buffers.read(self.counters, np.uint32)
        seconds = time.perf_counter() - started
        # all but the next pixel start again from zero, so that none can pass 32 bits
        self.counters.write(np.concatenate([values[:1], np.zeros(len(values) - 1, np.uint32)]))
        for name, value in zip(COUNTERS[1:], values[1:], strict=False):
            setattr(self.counts, name, getattr(self.counts, name) + int(value))
        self.counts.dispatches += 1
        self.counts.longest_dispatch_seconds = max(self.counts.longest_dispatch_seconds, seconds)
        self._adapt(self.options.dispatch_seconds * dispatch_share() / max(seconds, 1e-6))
        return values

    def _let_the_driver_compile(self) -> None:
        """A dispatch of no rounds, so that the true ones can be told from a device that hangs."""
        before = buffers.read(self.counters, np.uint32)
        with dispatching(software=is_software(self.context), compiles=True):
            self.program["round_count"] = 0
            self.program.run(1)
            self.context.memory_barrier()
            buffers.read(self.counters, np.uint32)
        self.counters.write(before)
        self.compiled = True

    def _adapt(self, factor: float) -> None:
        """Rounds of the next dispatch: that many times as many, at most doubled, within the budget."""
        if self.options.rounds_per_dispatch:
            return
        factor = min(2.0, max(0.25, factor))
        self.rounds = min(max(round(self.rounds * factor), 1), self.most_rounds)

    @property
    def most_rounds(self) -> int:
        """Rounds of a dispatch whose loops stay within the budget, whether or not the driver unrolls some."""
        layers = self.scene.pool.layer_count
        layers = layers if layers > 1 else 0
        layers += len(self.scene.media.homogeneous) if self.scene.media else 0
        steps = self.options.steps_per_round * (1 + layers)
        seeks = self.options.seeks_per_round if self.scene.surfaces else 0
        return max(1, LOOP_BUDGET // (1 + steps + seeks + 2 * layers + SLOWEST_SAMPLING_LOOP))

    def _upload(self) -> None:
        pool, ctx = self.scene.pool, self.context
        page_bricks = bricks_per_page(ctx, 4 * pool.brick_words)
        self.page_shift = page_bricks.bit_length() - 1
        records = brick_records(pool, self.scene.extinction_scale)
        if self.scene.config.shadows_by == "residual_ratio":
            projected = self.scene.config.extinction == "projected"
            records[:, 1] |= control_sixteenths(pool, projected=projected) << 28
        capacity = pool_capacity(self.scene)
        needed = -(-(capacity or len(pool.voxels)) // page_bricks)
        if needed > (most := page_limit(ctx.info)):
            raise DeviceMemoryError(
                f"render: {capacity or len(pool.voxels)} bricks need {needed} buffers; there are {most}.",
                hint="Set a smaller render.brick_pool_mb, or raise voxelize.voxel_size_mm.",
            )
        if capacity is None:
            buffers.refuse_what_has_no_room(ctx, len(pool.voxels) * 4 * pool.brick_words, name=VOXELS)
        self.pager = None if capacity is None else BrickPager(ctx, self.scene, capacity, records, page_bricks)
        self.cells = buffers.upload(ctx, pool.cells, name="the cells")
        if self.pager is None:
            self.pages = [
                buffers.upload(ctx, pool.voxels[start : start + page_bricks], name=VOXELS)
                for start in range(0, len(pool.voxels), page_bricks)
            ]
            self.bricks = buffers.upload(ctx, records, name="the bricks")
        else:
            self.pages, self.bricks = self.pager.pages, self.pager.bricks
        self.device_bytes = sum(buffer.size for buffer in (self.cells, self.bricks, *self.pages))
        self.counters = buffers.upload(ctx, np.zeros(WAITING_LANES + 1, np.uint32), name="the counters")

    def _reserve_states(self) -> None:
        correlated = self.scene.config.correlation != "none"
        self.state_words = STATE_WORDS + (self.scene.surfaces is not None) + CORRELATION_WORDS * correlated
        self.state_words += COLOR_WORDS * self.scene.colored
        size = self.lane_count * self.state_words * 16
        self.states = buffers.reserve(self.context, size, name=PATHS)

    def _upload_lights(self) -> moderngl.Buffer:
        return buffers.upload(self.context, self.scene.tables, name="the lights and surfaces")

    def _upload_media(self) -> moderngl.Buffer:
        name = "the scattering parameters"
        return buffers.upload(self.context, self.scene.phase.parameters, name=name)

    def _bind(self) -> None:
        named = (
            self.cells,
            self.bricks,
            self.states,
            self.film,
            self.lights,
            self.counters,
            self.media,
            *self.pages,
        )
        for binding, buffer in enumerate(named):
            assert buffer is not None
            buffer.bind_to_storage_buffer(binding)

    def _idle_states(self) -> np.ndarray:
        states = np.zeros((self.state_words, self.lane_count, 4), np.uint32)
        states[5, :, 3] = MODE_IDLE
        states[8, :, 0] = 0xFFFFFFFF
        return states

    def _compile(self) -> moderngl.ComputeShader:
        self.compiled = False
        return compute_program(
            self.context,
            "path/trace.comp",
            constants=self.scene.constants()
            | {
                "GROUP_SIZE": GROUP_SIZE,
                "STEPS_PER_ROUND": self.options.steps_per_round,
                "SEEKS_PER_ROUND": self.options.seeks_per_round,
                "BRICK_POOL": self.pager is not None,
            },
            pieces=self.scene.pieces()
            | {
                "generated/voxel_pages.glsl": self._voxel_pages(),
                "generated/parking.glsl": '#include "medium/parking.glsl"\n' if self.pager else "",
            },
        )

    def _voxel_pages(self) -> str:
        pool = self.scene.pool
        table = None if self.pager is None else len(pool.voxels)
        return voxel_pages_glsl(
            len(self.pages), self.page_shift, slot_table=table, brick_words=pool.brick_words
        )

    def release(self) -> None:
        """Give the device memory back."""
        named = (self.cells, self.bricks, self.lights, self.media, self.states, self.counters)
        for buffer in (*named, *self.pages):
            buffer.release()
        if self.film is not None:
            self.film.release()
        self.program.release()


def default_lane_count(context: moderngl.Context) -> int:
    """Enough lanes to fill the device; few where the processor does the work, to share its caches."""
    return 1 << 10 if is_software(context) else 1 << 18
