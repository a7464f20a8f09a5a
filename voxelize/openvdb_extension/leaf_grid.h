// What a grid to write is made of: arrays of whole leaves, or values packed in files.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <openvdb/openvdb.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

namespace nb = nanobind;

namespace {

constexpr size_t kLeafVoxels = 512;
constexpr int32_t kLeafSize = 8;
constexpr int32_t kCoordinateLimit = 1 << 30;
constexpr size_t kMaxLeaves = size_t(1) << 26;
constexpr size_t kLeavesAtOnce = 1024;
constexpr size_t kMaxOpenFiles = 64;

using Origins = nb::ndarray<const int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Masks = nb::ndarray<const uint64_t, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using FileIndices = nb::ndarray<const int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

// Files that stay open while leaves are read from them, the latest few of many.
class OpenFiles {
public:
    explicit OpenFiles(const std::vector<std::string>& paths) : mPaths(paths), mHandles(paths.size()) {}

    void read(size_t file, int64_t offset, void* to, size_t bytes) {
        const std::shared_ptr<Handle> handle = open(file);
        char* place = static_cast<char*>(to);
        while (bytes > 0) {
            const ssize_t count = ::pread(handle->descriptor, place, bytes, offset);
            if (count < 0 && errno == EINTR) continue;
            if (count <= 0) throw std::runtime_error(mPaths.at(file) + ": its values cannot be read");
            place += count;
            offset += count;
            bytes -= size_t(count);
        }
    }

private:
    struct Handle {
        explicit Handle(int d) : descriptor(d) {}
        ~Handle() { ::close(descriptor); }
        int descriptor;
    };

    std::shared_ptr<Handle> open(size_t file) {
        const std::lock_guard<std::mutex> lock(mMutex);
        std::shared_ptr<Handle>& handle = mHandles.at(file);
        if (!handle) {
            const int descriptor = ::open(mPaths[file].c_str(), O_RDONLY | O_CLOEXEC);
            if (descriptor < 0) throw std::runtime_error(mPaths[file] + ": cannot be opened");
            handle = std::make_shared<Handle>(descriptor);
            mOrder.push_back(file);
            if (mOrder.size() > kMaxOpenFiles) {
                mHandles[mOrder.front()].reset();
                mOrder.erase(mOrder.begin());
            }
        }
        return handle;
    }

    std::vector<std::string> mPaths;
    std::vector<std::shared_ptr<Handle>> mHandles;
    std::vector<size_t> mOrder;
    std::mutex mMutex;
};

// Values of leaves in files: of leaf i the active ones alone, from byte offsets[i] of paths[files[i]] on.
struct StoredValues {
    std::vector<std::string> paths;
    FileIndices files;
    Offsets offsets;
    size_t components;
    std::shared_ptr<OpenFiles> open;
};

// One grid to write. It keeps the arrays alive, so the leaves can be built without the GIL.
struct LeafGrid {
    std::string name;
    Origins origins;
    Masks masks;
    std::optional<Values> values;
    std::optional<StoredValues> stored;
    double voxelSize;
    std::array<double, 3> translation;
    std::string gridClass;
    std::string vectorType;
    openvdb::MetaMap metadata;
};

void requireThat(bool condition, const std::string& message) {
    if (!condition) throw std::invalid_argument(message);
}

void checkOrigins(const std::string& name, const int32_t* origins, size_t count) {
    std::vector<std::array<int32_t, 3>> sorted(count);
    for (size_t i = 0; i < count; ++i) {
        for (size_t axis = 0; axis < 3; ++axis) {
            const int32_t c = origins[3 * i + axis];
            requireThat(c % kLeafSize == 0, name + ": origin " + std::to_string(i) + " is not a multiple of 8");
            requireThat(c > -kCoordinateLimit && c < kCoordinateLimit,
                        name + ": origin " + std::to_string(i) + " lies beyond 2^30 voxels");
            sorted[i][axis] = c;
        }
    }
    // Tree::addLeaf would replace an earlier leaf without a word.
    tbb::parallel_sort(sorted.begin(), sorted.end());
    requireThat(std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end(), name + ": an origin repeats");
}

// 1 or 3.
size_t componentsOf(const LeafGrid& grid) {
    if (grid.stored) {
        requireThat(grid.stored->components == 1 || grid.stored->components == 3,
                    grid.name + ": stored values have neither 1 nor 3 components");
        return grid.stored->components;
    }
    requireThat(grid.values->ndim() == 2 || grid.values->ndim() == 3, grid.name + ": values have 2 or 3 axes");
    return grid.values->ndim() == 2 ? 1 : 3;
}

void checkShapes(const LeafGrid& grid, size_t components) {
    const size_t count = grid.origins.shape(0);
    requireThat(count <= kMaxLeaves, grid.name + ": more than 2^26 leaves");
    const size_t valueCount = grid.stored ? grid.stored->offsets.shape(0) : grid.values->shape(0);
    requireThat(grid.masks.shape(0) == count && valueCount == count,
                grid.name + ": origins, masks and values differ in length");
    if (grid.stored) {
        requireThat(grid.stored->files.shape(0) == count, grid.name + ": files and origins differ in length");
        for (size_t i = 0; i < count; ++i) {
            const int32_t file = grid.stored->files.data()[i];
            requireThat(file >= 0 && size_t(file) < grid.stored->paths.size() && grid.stored->offsets.data()[i] >= 0,
                        grid.name + ": leaf " + std::to_string(i) + " lies in no file");
        }
    } else {
        requireThat(grid.values->shape(1) == kLeafVoxels, grid.name + ": values hold not 512 voxels per leaf");
        requireThat(components == 1 || grid.values->shape(2) == 3, grid.name + ": vectors have not 3 components");
    }
    requireThat(grid.voxelSize > 0 && std::isfinite(grid.voxelSize), grid.name + ": voxel size is not positive");
}

openvdb::math::Transform::Ptr transformOf(const LeafGrid& source) {
    auto transform = openvdb::math::Transform::createLinearTransform(source.voxelSize);
    transform->postTranslate(openvdb::Vec3d(source.translation[0], source.translation[1], source.translation[2]));
    return transform;
}

// The 512 values of leaf i, zero where it is not active if they come from a file.
void fetchValues(const LeafGrid& source, size_t i, size_t components, float* out) {
    if (!source.stored) {
        std::memcpy(out, source.values->data() + i * kLeafVoxels * components, kLeafVoxels * components * sizeof(float));
        return;
    }
    std::array<float, kLeafVoxels * 3> packed;
    const uint64_t* mask = source.masks.data() + 8 * i;
    size_t active = 0;
    for (size_t word = 0; word < 8; ++word) active += size_t(__builtin_popcountll(mask[word]));
    source.stored->open->read(size_t(source.stored->files.data()[i]), source.stored->offsets.data()[i], packed.data(),
                              active * components * sizeof(float));
    std::memset(out, 0, kLeafVoxels * components * sizeof(float));
    const float* next = packed.data();
    for (size_t voxel = 0; voxel < kLeafVoxels; ++voxel) {
        if (mask[voxel / 64] >> (voxel % 64) & 1) {
            std::memcpy(out + voxel * components, next, components * sizeof(float));
            next += components;
        }
    }
}

template <typename MaskT>
MaskT maskOf(const LeafGrid& source, size_t i) {
    MaskT mask;
    for (uint32_t word = 0; word < 8; ++word) mask.template getWord<uint64_t>(word) = source.masks.data()[8 * i + word];
    return mask;
}

}  // namespace
