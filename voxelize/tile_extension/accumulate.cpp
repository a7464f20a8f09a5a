#include "accumulate.h"

#include <algorithm>

namespace weft {
namespace {

constexpr double kMeasureUnits = 4294967296.0;

// Ends and flags of up to sixteen segments; lanes without one get a segment of no length.
WEFT_INLINE void loadLanes(const SegmentList& list, size_t begin, Ends& ends, uint8_t* flags) {
    const size_t count = std::min(size_t(kLanes), list.count - begin);
    for (size_t l = 0; l < kLanes; ++l) {
        const size_t i = begin + (l < count ? l : 0);
        const float* a = list.points + 3 * list.stride * (list.order ? size_t(list.order[i]) : i);
        const uint8_t flag = l < count ? list.flags[i] : 0;
        const float* b = flag & kIsSegment ? a + 3 : a;
        for (int k = 0; k < 3; ++k) {
            ends.a[k][l] = a[k];
            ends.b[k][l] = b[k];
        }
        flags[l] = flag;
    }
}

// Twin: kernels.clipped_length.
WEFT_INLINE double clippedLength(const Ends& at, int l, const Placement& where) {
    double enter = 0.0, leave = 1.0, squared = 0.0;
    for (int k = 0; k < 3; ++k) {
        const double start = at.a[k][l], d = double(at.b[k][l]) - start;
        squared += d * d;
        if (d == 0.0) {
            if (start < where.regionLow[k] || start > where.regionHigh[k]) return 0.0;
        } else {
            const double u = (where.regionLow[k] - start) / d, v = (where.regionHigh[k] - start) / d;
            enter = std::max(enter, std::min(u, v));
            leave = std::min(leave, std::max(u, v));
        }
    }
    return std::sqrt(squared) * std::max(leave - enter, 0.0);
}

// Twin: kernels.lies_within, of every lane. Whether all of them do.
WEFT_INLINE bool lieWithin(const Ends& ends, const Placement& where, int32_t* within) {
    double margin = 0.0;
    for (size_t k = 0; k < 2 * where.lineCount; ++k) margin = std::max(margin, 2.0 * std::fabs(double(where.offsets[k])));
    int32_t all = 1;
    for (int l = 0; l < kLanes; ++l) within[l] = 1;
    for (int k = 0; k < 3; ++k) {
        for (int l = 0; l < kLanes; ++l) {
            const double low = std::min(ends.a[k][l], ends.b[k][l]), high = std::max(ends.a[k][l], ends.b[k][l]);
            within[l] &= int32_t((low - margin > where.regionLow[k]) & (high + margin < where.regionHigh[k]));
            all &= within[l];
        }
    }
    return all != 0;
}

// Two vectors across each segment. Frame after Duff et al. 2017. Twin: kernels.line_offset.
struct Frames {
    alignas(64) float u[3][kLanes];
    alignas(64) float v[3][kLanes];
};

WEFT_INLINE void framesOf(const Ends& ends, Frames& frames) {
    for (int l = 0; l < kLanes; ++l) {
        const float x = ends.b[0][l] - ends.a[0][l], y = ends.b[1][l] - ends.a[1][l], z = ends.b[2][l] - ends.a[2][l];
        const float length = std::sqrt(x * x + y * y + z * z);
        const float inverse = length > 0.0f ? 1.0f / length : 0.0f;
        const float tx = x * inverse, ty = y * inverse, tz = z * inverse;
        const float sign = tz < 0.0f ? -1.0f : 1.0f;
        const float c = -1.0f / (sign + tz);
        const float d = tx * ty * c;
        frames.u[0][l] = 1.0f + sign * tx * tx * c;
        frames.u[1][l] = sign * d;
        frames.u[2][l] = -sign * tx;
        frames.v[0][l] = d;
        frames.v[1][l] = sign + ty * ty * c;
        frames.v[2][l] = -ty;
    }
}

WEFT_INLINE void moveEnds(const Ends& ends, const Frames& frames, const float* offset, Ends& moved) {
    for (int k = 0; k < 3; ++k) {
        for (int l = 0; l < kLanes; ++l) {
            const float by = frames.u[k][l] * offset[0] + frames.v[k][l] * offset[1];
            moved.a[k][l] = ends.a[k][l] + by;
            moved.b[k][l] = ends.b[k][l] + by;
        }
    }
}

// Twin: kernels.segment_length_within.
WEFT_INLINE int64_t measure(const Ends& ends, const Frames& frames, const uint8_t* flags, const Placement& where) {
    alignas(64) int32_t within[kLanes];
    double lengths[kLanes] = {};
    if (!lieWithin(ends, where, within)) {
        Ends moved;
        for (size_t line = 0; line < where.lineCount; ++line) {
            if (where.lineCount > 1) moveEnds(ends, frames, where.offsets + 2 * line, moved);
            const Ends& at = where.lineCount > 1 ? moved : ends;
            for (int l = 0; l < kLanes; ++l) lengths[l] += within[l] ? 0.0 : clippedLength(at, l, where);
        }
        for (int l = 0; l < kLanes; ++l) lengths[l] /= double(where.lineCount);
    }
    int64_t total = 0;
    for (int l = 0; l < kLanes; ++l) {
        const double x = double(ends.b[0][l]) - double(ends.a[0][l]);
        const double y = double(ends.b[1][l]) - double(ends.a[1][l]);
        const double z = double(ends.b[2][l]) - double(ends.a[2][l]);
        const double length = within[l] ? std::sqrt(x * x + y * y + z * z) : lengths[l];
        total += flags[l] & kIsMeasured ? int64_t(length * kMeasureUnits) : 0;
    }
    return total;
}

// The pieces of a round, listed without a gap, since a branch for each would be guessed wrong.
struct Listed {
    alignas(64) float moment[kLanes][kSums];
    alignas(64) int32_t places[kRound * kLanes + kLanes];
    alignas(64) float units[kRound * kLanes + kLanes];
    alignas(64) int32_t lanes[kRound * kLanes + kLanes];
    int count = 0;
};

WEFT_INLINE void listPieces(TileSums& tile, const Walks& walks, const Pieces& pieces, int steps, Listed& listed) {
    std::memcpy(listed.moment, walks.moment, sizeof(listed.moment));
    int count = 0;
    for (int s = 0; s < steps; ++s) {
        for (int l = 0; l < kLanes; ++l) {
            listed.places[count] = pieces.place[s][l];
            listed.units[count] = pieces.units[s][l];
            listed.lanes[count] = l;
            count += int(pieces.place[s][l] >= 0);
        }
    }
    listed.count = count;
    for (int i = 0; i < count; ++i) __builtin_prefetch(tile.sums() + size_t(listed.places[i]) * kSums, 1);
}

WEFT_INLINE void deposit(TileSums& tile, const Listed& listed) {
    int32_t* sums = tile.sums();
    uint8_t* used = tile.used();
    for (int i = 0; i < listed.count; ++i) {
        const int32_t place = listed.places[i];
        const float length = listed.units[i];
        const float* moment = listed.moment[listed.lanes[i]];
        int32_t* voxel = sums + size_t(place) * kSums;
        for (int k = 0; k < kSums; ++k) voxel[k] += int32_t(length * moment[k]);
        used[place >> 9] = 1;
        if (__builtin_expect(voxel[0] > kFull, 0)) tile.empty(place);
    }
}

// A round is walked and its voxels are sent for before the round before it is added up: memory answers meanwhile.
struct Rounds {
    Listed lists[2];
    int latest = 0;
};

WEFT_INLINE void addLines(TileSums& tile, const Placement& where, const Ends& ends, const Ends& moved, Rounds& rounds) {
    Walks walks;
    Pieces pieces;
    const int most = beginWalks(ends, moved, where.box, where.inverseSize, where.scale, walks);
    for (int step = 0; step <= most; step += kRound) {
        const int steps = std::min(kRound, most + 1 - step);
        for (int s = 0; s < steps; ++s) {
            stepWalks(walks, step + s, where.box, tile.bricksPerSide(), pieces.place[s], pieces.units[s]);
        }
        const int before = rounds.latest;
        rounds.latest = 1 - before;
        listPieces(tile, walks, pieces, steps, rounds.lists[rounds.latest]);
        deposit(tile, rounds.lists[before]);
    }
}

}  // namespace

WEFT_FOR_EACH_PROCESSOR
int64_t addSegments(TileSums& tile, const Placement& where, const SegmentList& list) {
    int64_t length = 0;
    Ends ends, moved;
    Frames frames;
    Rounds rounds;
    uint8_t flags[kLanes];
    for (size_t begin = 0; begin < list.count; begin += kLanes) {
        loadLanes(list, begin, ends, flags);
        bool measured = false;
        for (int l = 0; l < kLanes; ++l) measured |= (flags[l] & kIsMeasured) != 0;
        if (where.lineCount > 1) framesOf(ends, frames);
        if (measured) length += measure(ends, frames, flags, where);
        if (where.lineCount == 1) {
            addLines(tile, where, ends, ends, rounds);
            continue;
        }
        for (size_t line = 0; line < where.lineCount; ++line) {
            moveEnds(ends, frames, where.offsets + 2 * line, moved);
            addLines(tile, where, ends, moved, rounds);
        }
    }
    deposit(tile, rounds.lists[rounds.latest]);
    return length;
}

}  // namespace weft
