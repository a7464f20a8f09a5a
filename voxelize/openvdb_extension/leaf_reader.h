// Reading whole leaves: the trees by libopenvdb, then the values, which are most of a file, straight from the mapped
// file into arrays, leaves in parallel. Files that are laid out otherwise are libopenvdb's alone.
#pragma once

#include "leaf_grid.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/GridDescriptor.h>
#include <tbb/parallel_for.h>

#include <fstream>
#include <istream>
#include <streambuf>

#include <sys/mman.h>
#include <sys/stat.h>

namespace {

constexpr size_t kMaskBytes = 64;
constexpr size_t kPage = 4096;

// A file mapped for reading, or memory to write to: of its own, or appended to a file that another process maps.
class Mapping {
public:
    Mapping() = default;
    Mapping(void* data, size_t bytes) : mData(data), mBytes(bytes) {
        if (data == MAP_FAILED) throw std::bad_alloc();
    }
    Mapping(Mapping&& other) noexcept : mData(other.mData), mBytes(other.mBytes) { other.mBytes = 0; }
    Mapping& operator=(Mapping&& other) noexcept {
        std::swap(mData, other.mData);
        std::swap(mBytes, other.mBytes);
        return *this;
    }
    ~Mapping() {
        if (mBytes) ::munmap(mData, mBytes);
    }
    void* data() const { return mData; }
    size_t bytes() const { return mBytes; }

private:
    void* mData = nullptr;
    size_t mBytes = 0;
};

Mapping mapFile(const std::string& path) {
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) throw std::runtime_error(path + ": cannot be opened");
    struct stat status {};
    ::fstat(descriptor, &status);
    const auto bytes = size_t(status.st_size);
    void* data = bytes ? ::mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE, descriptor, 0) : nullptr;
    ::close(descriptor);
    return Mapping(data, bytes);
}

// Where the arrays go.
class Arena {
public:
    // -1 for memory of its own; else a file to append to.
    explicit Arena(int file) : mFile(file) {}

    // Zeros. `offset` is where they begin in the file.
    Mapping allocate(size_t bytes, int64_t& offset) {
        offset = mEnd;
        const size_t whole = (std::max(bytes, size_t(1)) + kPage - 1) / kPage * kPage;
        if (mFile < 0) {
            Mapping memory(
                ::mmap(nullptr, whole, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0), whole);
#ifdef MADV_HUGEPAGE
            ::madvise(memory.data(), whole, MADV_HUGEPAGE);
#endif
            return memory;
        }
        if (::ftruncate(mFile, mEnd + off_t(whole)) != 0) throw std::bad_alloc();
        mEnd += int64_t(whole);
        return Mapping(::mmap(nullptr, whole, PROT_READ | PROT_WRITE, MAP_SHARED, mFile, offset), whole);
    }

    bool isFile() const { return mFile >= 0; }

private:
    int mFile;
    int64_t mEnd = 0;
};

struct OneArray {
    Mapping memory;
    int64_t offset = 0;
    template <typename T>
    T* as() const { return static_cast<T*>(memory.data()); }
};

// The leaves of a grid as arrays, made without the GIL.
struct LeafArrays {
    size_t count = 0;
    size_t components = 1;
    OneArray origins, masks, values;

    LeafArrays(Arena& arena, size_t leafCount, size_t width) : count(leafCount), components(width) {
        origins.memory = arena.allocate(count * 3 * sizeof(int32_t), origins.offset);
        masks.memory = arena.allocate(count * kMaskBytes, masks.offset);
        values.memory = arena.allocate(count * kLeafVoxels * components * sizeof(float), values.offset);
    }

    float* leafValues(size_t i) const { return values.as<float>() + i * kLeafVoxels * components; }

    template <typename LeafT>
    void putPlace(size_t i, const LeafT& leaf) const {
        for (int axis = 0; axis < 3; ++axis) origins.as<int32_t>()[3 * i + axis] = leaf.origin()[axis];
        for (uint32_t word = 0; word < 8; ++word) {
            masks.as<uint64_t>()[8 * i + word] = leaf.getValueMask().template getWord<uint64_t>(word);
        }
    }
};

// A stream on memory that is not copied.
class MemoryBuffer : public std::streambuf {
public:
    MemoryBuffer(const char* begin, const char* end) {
        setg(const_cast<char*>(begin), const_cast<char*>(begin), const_cast<char*>(end));
    }
};

// A grid of a file with its tree of masks; its values are still in the file.
struct UnreadGrid {
    openvdb::GridBase::Ptr grid;
    uint32_t compression;
    size_t values;
    size_t end;
};

// Walks the leaves of a file in the order of the tree. Twin of what io::writeCompressedValues writes.
class LeafWalk {
public:
    LeafWalk(const Mapping& file, const UnreadGrid& unread, size_t valueBytes)
        : mData(static_cast<const char*>(file.data())),
          mAt(unread.values),
          mEnd(std::min(unread.end, file.bytes())),
          mCompression(unread.compression),
          mValueBytes(valueBytes) {
        if (mAt > mEnd) throw std::runtime_error("the file ends within a grid");
    }

    // Where the values of the leaf begin, behind its mask; goes on to the next leaf.
    size_t next(size_t activeCount) {
        using namespace openvdb::io;
        skip(kMaskBytes);
        const size_t begin = mAt;
        const int8_t kind = *bytes(1);
        if (kind == NO_MASK_AND_ONE_INACTIVE_VAL || kind == MASK_AND_ONE_INACTIVE_VAL) skip(mValueBytes);
        if (kind == MASK_AND_TWO_INACTIVE_VALS) skip(2 * mValueBytes);
        if (kind == MASK_AND_NO_INACTIVE_VALS || kind == MASK_AND_ONE_INACTIVE_VAL ||
            kind == MASK_AND_TWO_INACTIVE_VALS) {
            skip(kMaskBytes);
        }
        if (mCompression & (COMPRESS_ZIP | COMPRESS_BLOSC)) {
            int64_t count = 0;
            std::memcpy(&count, bytes(sizeof(count)), sizeof(count));
            const uint64_t size = count < 0 ? 0 - uint64_t(count) : uint64_t(count);
            skip(size_t(std::min<uint64_t>(size, mEnd + 1)));
        } else {
            const bool all = !(mCompression & COMPRESS_ACTIVE_MASK) || kind == NO_MASK_AND_ALL_VALS;
            skip((all ? kLeafVoxels : activeCount) * mValueBytes);
        }
        return begin;
    }

private:
    const char* bytes(size_t count) {
        const size_t at = mAt;
        skip(count);
        return mData + at;
    }
    void skip(size_t count) {
        if (count > mEnd - mAt) throw std::runtime_error("the file ends within a grid");
        mAt += count;
    }

    const char* mData;
    size_t mAt;
    size_t mEnd;
    uint32_t mCompression;
    size_t mValueBytes;
};

bool hasActiveTiles(const openvdb::GridBase& grid) {
    return grid.isType<openvdb::FloatGrid>() ? static_cast<const openvdb::FloatGrid&>(grid).tree().hasActiveTiles()
                                             : static_cast<const openvdb::Vec3SGrid&>(grid).tree().hasActiveTiles();
}

// A .vdb file of the present layout, opened without its values.
class UnreadFile : public openvdb::io::Archive {
public:
    // False where libopenvdb must read the whole file by itself.
    bool open(const std::string& path) {
        std::ifstream stream(path, std::ios::binary);
        readHeader(stream);
        if (!inputHasGridOffsets() || fileVersion() < openvdb::OPENVDB_FILE_VERSION_MULTIPASS_IO) return false;
        mMetadata = std::make_shared<openvdb::io::StreamMetadata>();
        openvdb::io::setStreamMetadataPtr(stream, mMetadata, /*transfer=*/false);
        openvdb::io::setVersion(stream, libraryVersion(), fileVersion());
        openvdb::io::setDataCompression(stream, compression());
        openvdb::MetaMap().readMeta(stream);
        const int32_t count = readGridCount(stream);
        for (int32_t i = 0; i < count; ++i) {
            if (!openGrid(stream)) return false;
        }
        return true;
    }

    const std::vector<UnreadGrid>& grids() const { return mGrids; }

    // For libopenvdb's reader of single leaves.
    void describe(std::istream& stream, const UnreadGrid& unread, const void* background) const {
        openvdb::io::setVersion(stream, libraryVersion(), fileVersion());
        openvdb::io::setDataCompression(stream, unread.compression);
        openvdb::io::setGridClass(stream, unread.grid->getGridClass());
        openvdb::io::setGridBackgroundValuePtr(stream, background);
    }

private:
    bool openGrid(std::istream& stream) {
        openvdb::io::GridDescriptor place;
        openvdb::GridBase::Ptr grid = place.read(stream);
        const bool known = grid && (grid->isType<openvdb::FloatGrid>() || grid->isType<openvdb::Vec3SGrid>());
        if (!known || place.isInstance() || place.saveFloatAsHalf()) return false;
        place.seekToGrid(stream);
        openvdb::io::setGridClass(stream, openvdb::GRID_UNKNOWN);
        openvdb::io::setGridBackgroundValuePtr(stream, nullptr);
        readGridCompression(stream);
        grid->readMeta(stream);
        grid->removeMeta("file_delayed_load");
        openvdb::io::setGridClass(stream, grid->getGridClass());
        grid->readTransform(stream);
        grid->readTopology(stream);
        if (!stream) throw std::runtime_error("the file ends within a grid");
        if (hasActiveTiles(*grid)) return false;
        const uint32_t compression = openvdb::io::getDataCompression(stream);
        mGrids.push_back({grid, compression, size_t(stream.tellg()), size_t(place.getEndPos())});
        place.seekToEnd(stream);
        return true;
    }

    openvdb::io::StreamMetadata::Ptr mMetadata;
    std::vector<UnreadGrid> mGrids;
};

template <typename ValueT, typename MaskT>
void readLeaf(const UnreadFile& archive, const UnreadGrid& unread, const char* begin, const char* end,
              const MaskT& mask, const ValueT& background, ValueT* out) {
    using namespace openvdb::io;
    const bool packed = unread.compression == COMPRESS_ACTIVE_MASK;
    if (packed && *begin == NO_MASK_OR_INACTIVE_VALS && background == openvdb::zeroVal<ValueT>()) {
        const char* from = begin + 1;
        for (auto on = mask.beginOn(); on; ++on, from += sizeof(ValueT)) std::memcpy(out + on.pos(), from, sizeof(ValueT));
    } else if (packed && *begin == NO_MASK_AND_ALL_VALS) {
        std::memcpy(out, begin + 1, kLeafVoxels * sizeof(ValueT));
    } else {
        MemoryBuffer buffer(begin, end);
        std::istream stream(&buffer);
        archive.describe(stream, unread, &background);
        readCompressedValues(stream, out, openvdb::Index(kLeafVoxels), mask, /*fromHalf=*/false);
    }
}

// The leaves of a grid that UnreadFile has opened, sorted by origin.
template <typename GridT>
LeafArrays readLeaves(const UnreadFile& archive, const UnreadGrid& unread, const Mapping& file, Arena& arena,
                      size_t maxLeaves) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    const auto& grid = static_cast<const GridT&>(*unread.grid);
    requireThat(grid.tree().leafCount() <= maxLeaves, grid.getName() + ": more than " + std::to_string(maxLeaves) + " leaves");
    struct Place {
        const LeafT* leaf;
        size_t begin;
    };
    std::vector<const LeafT*> leaves;
    grid.tree().getNodes(leaves);
    std::vector<Place> places(leaves.size());
    LeafWalk walk(file, unread, sizeof(ValueT));
    for (size_t i = 0; i < leaves.size(); ++i) places[i] = {leaves[i], walk.next(leaves[i]->getValueMask().countOn())};
    tbb::parallel_sort(places.begin(), places.end(),
                       [](const Place& a, const Place& b) { return a.leaf->origin() < b.leaf->origin(); });
    LeafArrays arrays(arena, places.size(), sizeof(ValueT) / sizeof(float));
    const auto* data = static_cast<const char*>(file.data());
    tbb::parallel_for(size_t(0), places.size(), [&](size_t i) {
        const LeafT& leaf = *places[i].leaf;
        arrays.putPlace(i, leaf);
        readLeaf(archive, unread, data + places[i].begin, data + std::min(unread.end, file.bytes()),
                 leaf.getValueMask(), grid.background(), reinterpret_cast<ValueT*>(arrays.leafValues(i)));
    });
    return arrays;
}

// The leaves of a grid that libopenvdb has read.
template <typename GridT>
LeafArrays copyLeaves(GridT& grid, Arena& arena, size_t maxLeaves) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    auto& tree = grid.tree();
    if (tree.hasActiveTiles()) {
        requireThat(tree.activeVoxelCount() / kLeafVoxels < maxLeaves, grid.getName() + ": too many voxels in tiles");
        tree.voxelizeActiveTiles();
    }
    requireThat(tree.leafCount() <= maxLeaves, grid.getName() + ": more than " + std::to_string(maxLeaves) + " leaves");
    std::vector<const LeafT*> leaves;
    leaves.reserve(tree.leafCount());
    tree.getNodes(leaves);
    tbb::parallel_sort(leaves.begin(), leaves.end(),
                       [](const LeafT* a, const LeafT* b) { return a->origin() < b->origin(); });
    LeafArrays arrays(arena, leaves.size(), sizeof(ValueT) / sizeof(float));
    tbb::parallel_for(size_t(0), leaves.size(), [&](size_t i) {
        arrays.putPlace(i, *leaves[i]);
        std::memcpy(arrays.leafValues(i), leaves[i]->buffer().data(), kLeafVoxels * sizeof(ValueT));
    });
    return arrays;
}

}  // namespace
