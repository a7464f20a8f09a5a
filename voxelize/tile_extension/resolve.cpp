#include "resolve.h"

namespace weft {
namespace {

constexpr int kAtOnce = 8;

// Twin: kernels.THIRD_OF_ANGLE.
constexpr double kThirdOfAngle[] = {
    0.7660444431189773, 0.24740906632284596, -0.01550918843636095, 0.0024663528154554026,
    -0.0005041246941713294, 0.00011642544735162777, -2.8919908083649873e-05, 7.541116258522758e-06,
    -2.0359982138012955e-06, 5.64018149027463e-07, -1.592248868463443e-07, 4.612243144631487e-08,
    -1.3792790111301991e-08, 3.642254207918733e-09, -8.450712135305638e-10, 5.15250520454934e-10,
    -2.1940729610579496e-10,
};

// Symmetric matrices: xx, yy, zz, xy, xz, yz, with trace 1.
struct Matrices {
    alignas(64) double m[6][kAtOnce];
};

struct Axes {
    alignas(64) double axis[3][kAtOnce];
    alignas(64) double shift[kAtOnce];
    alignas(64) int64_t kind[kAtOnce];  // 0 found, 1 any axis will do, 2 two largest eigenvalues are equal
};

// Twin: kernels.largest_eigenvector.
WEFT_INLINE void largestEigenvectors(const Matrices& a, Axes& out) {
    for (int l = 0; l < kAtOnce; ++l) {
        const double mean = (a.m[0][l] + a.m[1][l] + a.m[2][l]) * (1.0 / 3.0);
        const double x = a.m[0][l] - mean, y = a.m[1][l] - mean, z = a.m[2][l] - mean;
        const double xy = a.m[3][l], xz = a.m[4][l], yz = a.m[5][l];
        const double squared = xy * xy + xz * xz + yz * yz;
        const double spread = std::sqrt((x * x + y * y + z * z + 2.0 * squared) * (1.0 / 6.0));
        const double determinant =
            x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
        const double inverse = 1.0 / spread;
        double cosine = 0.5 * determinant * inverse * inverse * inverse;
        cosine = cosine > -1.0 ? cosine : -1.0;
        cosine = cosine < 1.0 ? cosine : 1.0;
        const double half = 2.0 * std::sqrt(0.5 * (1.0 + cosine)) - 1.0;
        double third = kThirdOfAngle[16];
        for (int k = 15; k >= 0; --k) third = third * half + kThirdOfAngle[k];
        const double shift = 2.0 * spread * third;
        const double rx = x - shift, ry = y - shift, rz = z - shift;
        // cross products of two rows of the matrix without the eigenvalue on its diagonal
        const double ax = xy * yz - xz * ry, ay = xz * xy - rx * yz, az = rx * ry - xy * xy;
        const double bx = xy * rz - xz * yz, by = xz * xz - rx * rz, bz = rx * yz - xy * xz;
        const double cx = ry * rz - yz * yz, cy = yz * xz - xy * rz, cz = xy * yz - ry * xz;
        const double sa = ax * ax + ay * ay + az * az;
        const double sb = bx * bx + by * by + bz * bz;
        const double sc = cx * cx + cy * cy + cz * cz;
        const bool second = sb > sa;
        double size = second ? sb : sa;
        double vx = second ? bx : ax, vy = second ? by : ay, vz = second ? bz : az;
        const bool last = sc > size;
        size = last ? sc : size;
        vx = last ? cx : vx;
        vy = last ? cy : vy;
        vz = last ? cz : vz;
        const double scale = 1.0 / std::sqrt(size);
        out.axis[0][l] = vx * scale;
        out.axis[1][l] = vy * scale;
        out.axis[2][l] = vz * scale;
        out.shift[l] = mean + shift;
        const bool equal = !(size > 1.0e-24 * spread * spread * spread * spread);
        out.kind[l] = spread < 1.0e-12 ? 1 : (equal ? 2 : 0);
    }
}

// Twin: kernels.axis_in_plane.
void axisInPlane(const Matrices& a, int l, Axes& out) {
    const double rows[3][3] = {{a.m[0][l] - out.shift[l], a.m[3][l], a.m[4][l]},
                               {a.m[3][l], a.m[1][l] - out.shift[l], a.m[5][l]},
                               {a.m[4][l], a.m[5][l], a.m[2][l] - out.shift[l]}};
    const auto squared = [](const double* v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; };
    const double* normal = rows[0];
    if (squared(rows[1]) > squared(normal)) normal = rows[1];
    if (squared(rows[2]) > squared(normal)) normal = rows[2];
    const double scale = 1.0 / std::sqrt(squared(normal));
    const double n[3] = {normal[0] * scale, normal[1] * scale, normal[2] * scale};
    int main = 0;
    if (a.m[1][l] > a.m[0][l] && a.m[1][l] >= a.m[2][l]) {
        main = 1;
    } else if (a.m[2][l] > a.m[0][l]) {
        main = 2;
    }
    double v[3];
    for (int k = 0; k < 3; ++k) v[k] = (k == main ? 1.0 : 0.0) - n[k] * n[main];
    const double size = 1.0 / std::sqrt(squared(v));
    for (int k = 0; k < 3; ++k) out.axis[k][l] = v[k] * size;
}

// Voxels with fiber of one brick, in the order of the voxels.
struct Occupied {
    int voxel[kBrickVoxels + kAtOnce];
    int count = 0;
};

WEFT_INLINE void findOccupied(const int32_t* sums, const int64_t* large, Occupied& found) {
    int count = 0;
    for (int v = 0; v < kBrickVoxels; ++v) {
        found.voxel[count] = v;
        count += int(sums[v * kSums] > 0 || (large && large[v * kSums] > 0));
    }
    found.count = count;
}

WEFT_INLINE void putVector(float* place, double x, double y, double z) {
    place[0] = float(x);
    place[1] = float(y);
    place[2] = float(z);
}

WEFT_INLINE void resolveSome(const int32_t* sums, const int64_t* large, const int* voxels, int count,
                             double densityPerUnit, const BrickValues& values) {
    Matrices a;
    Axes axes;
    alignas(64) double length[kAtOnce];
    for (int l = 0; l < kAtOnce; ++l) {
        const int v = voxels[l < count ? l : 0] * kSums;
        int64_t s[6];
        for (int k = 0; k < 6; ++k) s[k] = int64_t(sums[v + k]) + (large ? large[v + k] : 0);
        const double inverse = 1.0 / double(s[0]);
        length[l] = double(s[0]);
        a.m[0][l] = double(s[1]) * inverse;
        a.m[1][l] = double(s[2]) * inverse;
        a.m[2][l] = double(s[0] - s[1] - s[2]) * inverse;
        for (int k = 3; k < 6; ++k) a.m[k][l] = double(s[k]) * inverse;
    }
    largestEigenvectors(a, axes);
    for (int l = 0; l < count; ++l) {
        if (axes.kind[l] == 1) {
            axes.axis[0][l] = axes.axis[1][l] = 0.0;
            axes.axis[2][l] = 1.0;
        } else if (axes.kind[l] == 2) {
            axisInPlane(a, l, axes);
        }
        const int v = voxels[l];
        const float x = float(axes.axis[0][l]), y = float(axes.axis[1][l]), z = float(axes.axis[2][l]);
        const bool flip = z < 0.0f || (z == 0.0f && (y < 0.0f || (y == 0.0f && x < 0.0f)));
        values.density[v] = float(length[l] * densityPerUnit);
        putVector(values.direction + 3 * v, flip ? -x : x, flip ? -y : y, flip ? -z : z);
        if (values.momentDiag) {
            putVector(values.momentDiag + 3 * v, a.m[0][l], a.m[1][l], a.m[2][l]);
            putVector(values.momentOff + 3 * v, a.m[3][l], a.m[4][l], a.m[5][l]);
        }
    }
}

}  // namespace

WEFT_FOR_EACH_PROCESSOR
void resolveBricks(TileSums& tile, const int32_t* bricks, size_t count, double densityPerUnit,
                   const BrickValues& values) {
    Occupied found;
    for (size_t row = 0; row < count; ++row) {
        const size_t brick = size_t(bricks[row]);
        const int32_t* sums = tile.sums() + brick * kBrickVoxels * kSums;
        const int64_t* large = tile.large(brick);
        const size_t first = row * kBrickVoxels;
        const BrickValues own{values.density + first, values.direction + 3 * first,
                              values.momentDiag ? values.momentDiag + 3 * first : nullptr,
                              values.momentOff ? values.momentOff + 3 * first : nullptr};
        findOccupied(sums, large, found);
        for (int begin = 0; begin < found.count; begin += kAtOnce) {
            const int some = found.count - begin < kAtOnce ? found.count - begin : kAtOnce;
            resolveSome(sums, large, found.voxel + begin, some, densityPerUnit, own);
        }
        tile.clear(brick);
    }
}

}  // namespace weft
