// The peer of test_voxel_speed.py: segments clipped against voxel faces into one dense array of seven float sums
// (length, and six of the second moment), plain and single-threaded. Arguments: segments file, voxel size, voxels
// per side, repeats. Prints the processor seconds of the fastest repeat and the sum of lengths in mm.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

static void accumulate(const float* s, float inverse, int n, std::vector<float>& sums) {
    float p[3], d[3], length = 0;
    int voxel[3], last[3], step[3];
    for (int k = 0; k < 3; ++k) {
        p[k] = s[k] * inverse;
        d[k] = (s[3 + k] - s[k]) * inverse;
        length += d[k] * d[k];
        voxel[k] = int(std::floor(p[k]));
        last[k] = int(std::floor(s[3 + k] * inverse));
        step[k] = last[k] > voxel[k] ? 1 : -1;
    }
    length = std::sqrt(length);
    if (!(length > 0)) return;
    const float t[3] = {d[0] / length, d[1] / length, d[2] / length};
    const float moment[6] = {t[0] * t[0], t[1] * t[1], t[2] * t[2], t[0] * t[1], t[0] * t[2], t[1] * t[2]};
    float reached = 0;
    for (;;) {
        float next = 1;
        int axis = -1;
        for (int k = 0; k < 3; ++k) {
            if (voxel[k] == last[k]) continue;
            const float u = (float(std::max(voxel[k], voxel[k] + step[k])) - p[k]) / d[k];
            if (axis < 0 || u < next) { next = u; axis = k; }
        }
        next = axis < 0 ? 1.0f : std::min(std::max(next, reached), 1.0f);
        if (voxel[0] >= 0 && voxel[1] >= 0 && voxel[2] >= 0 && voxel[0] < n && voxel[1] < n && voxel[2] < n) {
            float* sum = &sums[((size_t(voxel[0]) * n + voxel[1]) * n + voxel[2]) * 7];
            const float piece = (next - reached) * length;
            sum[0] += piece;
            for (int k = 0; k < 6; ++k) sum[1 + k] += piece * moment[k];
        }
        if (axis < 0) return;
        reached = next;
        voxel[axis] += step[axis];
    }
}

int main(int, char** arguments) {
    const float size = float(std::atof(arguments[2]));
    const int n = std::atoi(arguments[3]), repeats = std::atoi(arguments[4]);
    std::FILE* file = std::fopen(arguments[1], "rb");
    std::fseek(file, 0, SEEK_END);
    std::vector<float> segments(size_t(std::ftell(file)) / sizeof(float));
    std::rewind(file);
    if (std::fread(segments.data(), sizeof(float), segments.size(), file) != segments.size()) return 1;
    double best = 1e30, total = 0;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        std::vector<float> sums(size_t(n) * n * n * 7, 0.0f);
        const std::clock_t begin = std::clock();
        for (size_t i = 0; i + 6 <= segments.size(); i += 6) accumulate(&segments[i], 1 / size, n, sums);
        best = std::min(best, double(std::clock() - begin) / CLOCKS_PER_SEC);
        total = 0;
        for (size_t i = 0; i < sums.size(); i += 7) total += sums[i] * size;
    }
    std::printf("%g %.9g\n", best, total);
}
