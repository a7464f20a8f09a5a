// Sixteen segments at a time from their ends to pieces within voxels: Amanatides and Woo 1987, one segment a lane.
//
// Plain loops over lanes, for the compiler to make vectors of. Every operation is the one of kernels.py, its twin, in
// the same order and rounded by itself (-ffp-contract=off), so that both give the same bits on any machine.
#pragma once

#include <cstdlib>  // defines __GLIBC__

#include "vectors.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace weft {

constexpr int kLanes = 16;
constexpr int kSums = 8;    // l, xx, yy, xy, xz, yz, and two that stay zero: a voxel is half a line of cache
constexpr int kRound = 12;  // steps of a walk before its pieces are added up
constexpr float kNever = 2.0f;

struct Box {
    int32_t origin[3];
    int32_t low[3];
    int32_t high[3];
};

// Ends of segments, and by how much both were moved.
struct Ends {
    alignas(64) float a[3][kLanes];
    alignas(64) float b[3][kLanes];
};

// Walks under way. Voxels are counted from the tile's origin.
struct Walks {
    alignas(64) float p[3][kLanes];
    alignas(64) float inverse[3][kLanes];
    alignas(64) float face[3][kLanes];
    alignas(64) float next[3][kLanes];
    alignas(64) int32_t voxel[3][kLanes];
    alignas(64) int32_t left[3][kLanes];
    alignas(64) int32_t step[3][kLanes];
    alignas(64) int32_t crossings[kLanes];
    alignas(64) float reached[kLanes];
    alignas(64) float units[kLanes];
    alignas(64) float moment[kLanes][kSums];
};

// Pieces of a round, by step and lane. `place` is the voxel's index in the tile, or -1.
struct Pieces {
    alignas(64) int32_t place[kRound][kLanes];
    alignas(64) float units[kRound][kLanes];
};


// Twin: the beginning of kernels.accumulate_line. The most crossings of any lane, -1 where none meets the box.
WEFT_INLINE int beginWalks(const Ends& ends, const Ends& moved, const Box& box, float inverseSize, float scale,
                           Walks& w) {
    alignas(64) int32_t meets[kLanes];
    alignas(64) float d[3][kLanes];
    for (int l = 0; l < kLanes; ++l) meets[l] = 1;
    for (int k = 0; k < 3; ++k) {
        for (int l = 0; l < kLanes; ++l) {
            const float p = moved.a[k][l] * inverseSize;
            const float q = moved.b[k][l] * inverseSize;
            d[k][l] = (ends.b[k][l] - ends.a[k][l]) * inverseSize;
            const int32_t i = int32_t(std::floor(p));
            const int32_t j = int32_t(std::floor(q));
            meets[l] &= int32_t((i > j ? i : j) >= box.low[k]) & int32_t((i < j ? i : j) < box.high[k]);
            const int32_t step = j > i ? 1 : -1;
            const int32_t left = j > i ? j - i : i - j;
            w.p[k][l] = p;
            w.inverse[k][l] = 1.0f / d[k][l];
            w.face[k][l] = float(j > i ? i + 1 : i);
            w.next[k][l] = left > 0 ? (w.face[k][l] - p) * w.inverse[k][l] : kNever;
            w.voxel[k][l] = i - box.origin[k];
            w.left[k][l] = left;
            w.step[k][l] = step;
        }
    }
    for (int l = 0; l < kLanes; ++l) {
        const float length = std::sqrt(d[0][l] * d[0][l] + d[1][l] * d[1][l] + d[2][l] * d[2][l]);
        const float inverse = 1.0f / length;
        const float x = d[0][l] * inverse, y = d[1][l] * inverse, z = d[2][l] * inverse;
        const bool walks = meets[l] != 0 && length > 0.0f;
        w.units[l] = length * scale;
        w.reached[l] = 0.0f;
        w.crossings[l] = walks ? w.left[0][l] + w.left[1][l] + w.left[2][l] : -1;
        w.moment[l][0] = 1.0f;
        w.moment[l][1] = x * x;
        w.moment[l][2] = y * y;
        w.moment[l][3] = x * y;
        w.moment[l][4] = x * z;
        w.moment[l][5] = y * z;
        w.moment[l][6] = 0.0f;
        w.moment[l][7] = 0.0f;
    }
    int most = -1;
    for (int l = 0; l < kLanes; ++l) most = w.crossings[l] > most ? w.crossings[l] : most;
    return most;
}

// Twin: one turn of the loop of kernels.accumulate_line, the `step`-th.
WEFT_INLINE void stepWalks(Walks& w, int step, const Box& box, int32_t bricksPerSide, int32_t* place, float* units) {
    const int32_t lowX = box.low[0] - box.origin[0], sizeX = box.high[0] - box.low[0];
    const int32_t lowY = box.low[1] - box.origin[1], sizeY = box.high[1] - box.low[1];
    const int32_t lowZ = box.low[2] - box.origin[2], sizeZ = box.high[2] - box.low[2];
    for (int l = 0; l < kLanes; ++l) {
        const float nx = w.next[0][l], ny = w.next[1][l], nz = w.next[2][l];
        const int32_t x = w.voxel[0][l], y = w.voxel[1][l], z = w.voxel[2][l];
        const bool alongX = (nx <= ny) & (nx <= nz);
        const bool alongY = !alongX & (ny <= nz);
        const bool alongZ = !alongX & !alongY;
        // rounding may put a face a hair before the previous one or behind the end
        float until = alongX ? nx : (alongY ? ny : nz);
        until = until > w.reached[l] ? until : w.reached[l];
        until = until < 1.0f ? until : 1.0f;
        until = step == w.crossings[l] ? 1.0f : until;
        const float length = (until - w.reached[l]) * w.units[l] + 0.5f;
        w.reached[l] = until;
        const bool inside = (uint32_t(x - lowX) < uint32_t(sizeX)) & (uint32_t(y - lowY) < uint32_t(sizeY)) &
                            (uint32_t(z - lowZ) < uint32_t(sizeZ)) & (step <= w.crossings[l]) & (length >= 1.0f);
        const int32_t brick = ((x >> 3) * bricksPerSide + (y >> 3)) * bricksPerSide + (z >> 3);
        const int32_t local = ((x & 7) << 6) | ((y & 7) << 3) | (z & 7);
        place[l] = inside ? brick * 512 + local : -1;
        units[l] = length;

        const int32_t stepX = alongX ? w.step[0][l] : 0;
        const int32_t stepY = alongY ? w.step[1][l] : 0;
        const int32_t stepZ = alongZ ? w.step[2][l] : 0;
        w.voxel[0][l] = x + stepX;
        w.voxel[1][l] = y + stepY;
        w.voxel[2][l] = z + stepZ;
        w.left[0][l] -= int32_t(alongX);
        w.left[1][l] -= int32_t(alongY);
        w.left[2][l] -= int32_t(alongZ);
        w.face[0][l] += float(stepX);
        w.face[1][l] += float(stepY);
        w.face[2][l] += float(stepZ);
        w.next[0][l] = w.left[0][l] > 0 ? (w.face[0][l] - w.p[0][l]) * w.inverse[0][l] : kNever;
        w.next[1][l] = w.left[1][l] > 0 ? (w.face[1][l] - w.p[1][l]) * w.inverse[1][l] : kNever;
        w.next[2][l] = w.left[2][l] > 0 ? (w.face[2][l] - w.p[2][l]) * w.inverse[2][l] : kNever;
    }
}

}  // namespace weft
