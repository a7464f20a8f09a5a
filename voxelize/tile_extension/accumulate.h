// Segments into the sums of a tile, and the fiber length among them.
#pragma once

#include "tile_sums.h"

namespace weft {

constexpr uint8_t kIsSegment = 1;
constexpr uint8_t kIsMeasured = 2;

// Points of fibers, and which of them begin a segment: number i goes from points[i * stride] to the point after it.
struct SegmentList {
    const float* points;
    const uint8_t* flags;
    const int32_t* order;  // numbers of the segments to add, or null for all; flags then go by place in it
    size_t count;
    size_t stride;
};

struct Placement {
    Box box;
    float inverseSize;
    float scale;           // units of a voxel size of length, for each line
    const float* offsets;  // of the lines that stand for a fiber [mm], shape [lineCount, 2]
    size_t lineCount;
    double regionLow[3];
    double regionHigh[3];
};

// The length within the region of the segments to be measured, in 2^-32 mm.
int64_t addSegments(TileSums& tile, const Placement& placement, const SegmentList& list);

}  // namespace weft
