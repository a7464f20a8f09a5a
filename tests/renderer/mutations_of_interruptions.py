"""Faults to inject into what keeps, resumes and joins samples, each with a test that must turn red."""

from __future__ import annotations

from tests.faults import Mutation

CHECKPOINT = "tests/renderer/test_checkpoint.py::"
MERGE = "tests/renderer/test_merge.py::"
ROOM = "tests/renderer/test_room.py::"
WATCHDOG = "tests/pipeline/test_watchdog.py::"
ANY_SHARES = MERGE + "test_shares_of_blocks_and_tiles_in_any_order_make_the_bits_of_one_run"
RESUMED = CHECKPOINT + "test_checkpoints_on_the_way_resume_too"
STOPPED = CHECKPOINT + "test_a_stopped_picture_holds_whole_blocks_of_each_pixel"
OTHER_PICTURE = MERGE + "test_shares_of_another_picture_are_refused_by_the_field_that_differs"
DAMAGED = CHECKPOINT + "test_a_truncated_or_damaged_checkpoint_is_refused"

INTERRUPTION_MUTATIONS = (
    Mutation(
        "blocks folded in the order of the files",
        "renderer/merge.py",
        "key=lambda piece: (piece.samples.start, piece.path.name)",
        "key=lambda piece: piece.path.name",
        ANY_SHARES,
        sign="MergeError",
    ),
    Mutation(
        "blocks folded in float32",
        "renderer/merge.py",
        "film.sums[:, here] += units[piece.number].sums",
        "film.sums[:, here] = np.float32(film.sums[:, here]) + units[piece.number].sums",
        ANY_SHARES,
    ),
    Mutation(
        "a block folded last to first",
        "renderer/blocks.py",
        "self.folded += self.rest.pop(0)",
        "self.folded += self.rest.pop(-1 - (self.begun is not None))",
        CHECKPOINT + "test_blocks_are_folded_in_ascending_order",
    ),
    Mutation(
        "samples counted one too few",
        "renderer/merge.py",
        "samples[here] = piece.samples.stop",
        "samples[here] = piece.samples.stop - 1",
        ANY_SHARES,
        sign="MergeError",
    ),
    Mutation(
        "overlap accepted",
        "renderer/merge.py",
        "if (done > piece.samples.start).any():",
        "if (done > piece.samples.stop).any():",
        MERGE + "test_a_share_given_twice_or_that_overlaps_is_refused",
        sign="DID NOT RAISE",
    ),
    Mutation(
        "hole accepted",
        "renderer/merge.py",
        "complete = bool(np.all(film.samples == wished))",
        "complete = bool(np.any(film.samples == wished))",
        MERGE + "test_a_missing_share_is_a_hole",
        sign="DID NOT RAISE",
    ),
    Mutation(
        "volume left out of the identity",
        "renderer/identity.py",
        '"volume": volume_sha256,',
        '"volume": "",',
        OTHER_PICTURE,
        sign="DID NOT RAISE",
    ),
    Mutation(
        "lights left out of the identity",
        "renderer/identity.py",
        '"lights and surfaces": _hash(scene.tables),',
        '"lights and surfaces": "",',
        OTHER_PICTURE,
        sign="Regex pattern did not match",
    ),
    Mutation(
        "seed left out of the identity",
        "renderer/identity.py",
        'NOT_DECIDING = {"samples_per_pixel",',
        'NOT_DECIDING = {"seed", "samples_per_pixel",',
        CHECKPOINT + "test_a_checkpoint_of_another_picture_is_refused_by_name",
        sign="DID NOT RAISE",
    ),
    Mutation(
        "device not compared",
        "renderer/identity.py",
        "if here != there:",
        'if here != there and name != "device":',
        MERGE + "test_the_device_counts_too",
        sign="DID NOT RAISE",
    ),
    Mutation(
        "truncated file accepted",
        "renderer/checkpoint.py",
        'raise MergeError("no checkpoint, or a truncated one: its end is missing.", path=path)',
        "return",
        DAMAGED,
        sign="Error",
    ),
    Mutation(
        "hash of the file not compared",
        "renderer/checkpoint.py",
        "if seal != SEAL + digest.digest():",
        "if len(seal) != len(SEAL + digest.digest()):",
        DAMAGED,
        sign="Error",
    ),
    Mutation(
        "checkpoint written in place",
        "renderer/checkpoint.py",
        "    with atomic_write(path) as temporary:\n        write_parts",
        "    for temporary in [Path(path)]:\n        write_parts",
        CHECKPOINT + "test_a_disk_that_fills_up_at_any_byte_leaves_the_previous_checkpoint",
        sign="OSError",
    ),
    Mutation(
        "halves of float64 sums exchanged",
        "renderer/checkpoint.py",
        'for k, half in enumerate(("low", "high"))',
        'for k, half in enumerate(("high", "low"))',
        RESUMED,
        sign="reads back differently",
    ),
    Mutation(
        "sample lost between passes",
        "renderer/exposure.py",
        "return Pass(tile.window, range(tile.until, min(",
        "return Pass(tile.window, range(tile.until + (tile.until > 0), min(",
        STOPPED,
    ),
    Mutation(
        "state of one path lost",
        "renderer/kernel.py",
        "self.states.write(np.ascontiguousarray(lanes))",
        "lanes = lanes.copy()\n        lanes[5, -1:, 3] = 4\n        self.states.write(lanes)",
        RESUMED,
    ),
    Mutation(
        "random dimension not kept",
        "renderer/kernel.py",
        "self.states.write(np.ascontiguousarray(lanes))",
        "lanes = lanes.copy()\n        lanes[7, :, 3] += np.uint32(lanes[8, 0, 0] < 0xFFFFFFFF)\n"
        "        self.states.write(lanes)",
        RESUMED,
    ),
    Mutation(
        "sums of the begun pass lost",
        "renderer/kernel.py",
        "self._fill_film(state.sums)",
        "self._fill_film(state.sums * (state.taken == 0))",
        RESUMED,
    ),
    Mutation(
        "next pixel not kept",
        "renderer/checkpoint.py",
        'np.stack(sums), np.zeros(0), header["taken"], header["image_width"]',
        'np.stack(sums), np.zeros(0), 0, header["image_width"]',
        RESUMED,
    ),
    Mutation(
        "unfinished blocks counted as finished",
        "renderer/passes.py",
        "finished[sample // block_samples - blocks.start, (row - top) * width + column - left] = False",
        "finished[sample // block_samples - blocks.start, (row - top) * width + column - left] &= True",
        STOPPED,
    ),
    Mutation(
        "trial taken anew on resuming",
        "renderer/exposure.py",
        'if previous is not None and previous.notes["asked"] == self._asked():',
        "if False:",
        CHECKPOINT + "test_noise_decides_once",
    ),
    Mutation(
        "twice of what the device has taken",
        "renderer/gpu/buffers.py",
        "if byte_count > (available := free_bytes(context)):",
        "if byte_count > 2 * (available := free_bytes(context)):",
        ROOM + "test_a_smaller_device_makes_the_same_bits_or_names_the_bytes",
    ),
    Mutation(
        "sleep not noticed",
        "pipeline/watchdog.py",
        "slept_too_long = self.asleep > self.limit",
        "slept_too_long = False",
        WATCHDOG + "test_work_that_a_busy_machine_holds_up_does_not_hang",
    ),
    Mutation(
        "waiting for a processor taken for sleep",
        "pipeline/watchdog.py",
        "int(ran) + int(waited) for ran, waited, _ in times",
        "int(ran) for ran, waited, _ in times",
        WATCHDOG + "test_waiting_for_a_processor_is_no_sleep",
    ),
)
