// Writing grids leaf by leaf, and comparing what is in the file; memory for masks alone, however many leaves.
#pragma once

#include "leaf_grid.h"

#include <openvdb/io/File.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <tbb/parallel_for.h>

#include <fstream>
#include <sstream>

namespace {

constexpr size_t kChecked = size_t(1) << 20;

// Of one block of kChecked bytes, the last one shorter, after those before: tells whether the disk gives back what was
// written. Eight bytes a step, as Fowler, Noll and Vo's FNV-1a does with one.
uint64_t checksum(const char* data, size_t count, uint64_t hash = 14695981039346656037ull) {
    size_t i = 0;
    for (; i + 8 <= count; i += 8) {
        uint64_t word;
        std::memcpy(&word, data + i, 8);
        hash = (hash ^ word) * 1099511628211ull;
        hash ^= hash >> 29;
    }
    for (; i < count; ++i) hash = (hash ^ uint8_t(data[i])) * 1099511628211ull;
    return hash;
}

// Where in the file the values of a grid lie.
struct WrittenRange {
    std::streamoff begin = 0;
    std::streamoff end = 0;
    uint64_t hash = checksum(nullptr, 0);
};

// A grid whose tree holds masks and no values, and those only while it is being written: the topology first, then
// the values, leaf by leaf in the order of the tree, as LeafNode writes them.
template <typename GridT>
class StreamedGrid : public GridT {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    static_assert(sizeof(ValueT) % sizeof(float) == 0 && LeafT::SIZE == kLeafVoxels, "unexpected leaf layout");
    static constexpr size_t kComponents = sizeof(ValueT) / sizeof(float);

public:
    explicit StreamedGrid(const LeafGrid& source) : mSource(source), mOrder(source.origins.shape(0)) {
        checkShapes(source, kComponents);
        checkOrigins(source.name, source.origins.data(), mOrder.size());
        for (size_t i = 0; i < mOrder.size(); ++i) mOrder[i] = uint32_t(i);
        tbb::parallel_sort(mOrder.begin(), mOrder.end(),
                           [this](uint32_t a, uint32_t b) { return originOf(a) < originOf(b); });
        buildTree();
        addStats();
        dropTree();
    }

    void writeTopology(std::ostream& os) const override {
        auto* self = const_cast<StreamedGrid*>(this);
        self->buildTree();
        GridT::writeTopology(os);
    }

    void writeBuffers(std::ostream& os) const override {
        std::vector<const LeafT*> leaves;
        leaves.reserve(mOrder.size());
        this->tree().getNodes(leaves);
        std::vector<std::string> blocks(std::min(leaves.size(), kLeavesAtOnce));
        mWritten = WrittenRange{os.tellp()};
        std::string unwritten;
        unwritten.reserve(2 * kChecked);
        for (size_t begin = 0; begin < leaves.size(); begin += kLeavesAtOnce) {
            const size_t count = std::min(kLeavesAtOnce, leaves.size() - begin);
            tbb::parallel_for(size_t(0), count, [&](size_t i) { blocks[i] = leafBytes(os, *leaves[begin + i]); });
            for (size_t i = 0; i < count; ++i) {
                unwritten += blocks[i];
                if (unwritten.size() >= kChecked) writeBlock(os, unwritten, kChecked);
            }
        }
        writeBlock(os, unwritten, unwritten.size());
        mWritten.end = os.tellp();
        const_cast<StreamedGrid*>(this)->dropTree();
    }

    const WrittenRange& written() const { return mWritten; }

private:
    openvdb::Coord originOf(size_t i) const {
        const int32_t* o = mSource.origins.data() + 3 * i;
        return openvdb::Coord(o[0], o[1], o[2]);
    }

    void buildTree() {
        for (const uint32_t i : mOrder) {
            auto leaf = std::make_unique<LeafT>(openvdb::PartialCreate(), originOf(i), openvdb::zeroVal<ValueT>());
            leaf->setValueMask(maskOf<typename LeafT::NodeMaskType>(mSource, i));
            this->tree().addLeaf(leaf.release());
        }
    }

    void dropTree() { this->tree().clear(); }

    // What File::write would add, but for the values that the tree does not hold.
    void addStats() {
        this->addStatsMetadata();
        const auto bytes = int64_t(this->tree().memUsage() + mOrder.size() * kLeafVoxels * sizeof(ValueT));
        this->insertMeta(openvdb::GridBase::META_FILE_MEM_BYTES, openvdb::Int64Metadata(bytes));
    }

    void writeBlock(std::ostream& os, std::string& bytes, size_t count) const {
        os.write(bytes.data(), std::streamsize(count));
        mWritten.hash = checksum(bytes.data(), count, mWritten.hash);
        bytes.erase(0, count);
    }

    std::string leafBytes(std::ostream& os, const LeafT& empty) const {
        const auto place = std::lower_bound(mOrder.begin(), mOrder.end(), empty.origin(),
                                            [this](uint32_t i, const openvdb::Coord& c) { return originOf(i) < c; });
        LeafT leaf(empty.origin(), openvdb::zeroVal<ValueT>(), false);
        leaf.setValueMask(empty.getValueMask());
        fetchValues(mSource, *place, kComponents, reinterpret_cast<float*>(leaf.buffer().data()));
        std::ostringstream bytes(std::ios::binary);
        openvdb::io::setDataCompression(bytes, openvdb::io::getDataCompression(os));
        openvdb::io::setGridBackgroundValuePtr(bytes, openvdb::io::getGridBackgroundValuePtr(os));
        leaf.writeBuffers(bytes, /*toHalf=*/false);
        return std::move(bytes).str();
    }

    const LeafGrid& mSource;
    std::vector<uint32_t> mOrder;  // leaves by origin
    mutable WrittenRange mWritten;
};

template <typename GridT>
openvdb::GridBase::Ptr buildGrid(const LeafGrid& source) {
    auto grid = std::make_shared<StreamedGrid<GridT>>(source);
    grid->setTransform(transformOf(source));
    for (auto item = source.metadata.beginMeta(); item != source.metadata.endMeta(); ++item) {
        grid->insertMeta(item->first, *item->second);
    }
    grid->setName(source.name);
    // both conversions take an unknown name for "unknown" or "invariant" without a word
    const auto gridClass = openvdb::GridBase::stringToGridClass(source.gridClass);
    requireThat(openvdb::GridBase::gridClassToString(gridClass) == source.gridClass,
                source.name + ": no grid class '" + source.gridClass + "'");
    grid->setGridClass(gridClass);
    grid->setCreator("weft");
    const auto vectorType = openvdb::GridBase::stringToVecType(source.vectorType);
    requireThat(openvdb::GridBase::vecTypeToString(vectorType) == source.vectorType,
                source.name + ": no vector type '" + source.vectorType + "'");
    if (componentsOf(source) == 3) grid->setVectorType(vectorType);
    return grid;
}

// io::File::write does not notice a stream that fails; this does. It also leaves out the list of compressed sizes of
// all leaves (file_delayed_load), which Archive::write takes from trees that here hold no values. The list is
// optional: readers that leave values on the disk then find each leaf by walking the file.
class CheckedArchive : public openvdb::io::Archive {
public:
    void writeTo(std::ostream& stream, const openvdb::GridCPtrVec& grids, const openvdb::MetaMap& metadata) const {
        writeHeader(stream, /*seekable=*/true);
        metadata.writeMeta(stream);
        const auto count = int32_t(grids.size());
        stream.write(reinterpret_cast<const char*>(&count), sizeof(count));
        for (const auto& grid : grids) writeOne(stream, *grid);
    }

private:
    void writeOne(std::ostream& stream, const openvdb::GridBase& grid) const {
        openvdb::io::GridDescriptor place(grid.getName(), grid.type());
        place.writeHeader(stream);
        const auto positions = stream.tellp();
        place.writeStreamPos(stream);
        place.setGridPos(stream.tellp());
        setGridCompression(stream, grid);
        grid.writeMeta(stream);
        grid.writeTransform(stream);
        grid.writeTopology(stream);
        place.setBlockPos(stream.tellp());
        grid.writeBuffers(stream);
        place.setEndPos(stream.tellp());
        stream.seekp(positions);
        place.writeStreamPos(stream);
        place.seekToEnd(stream);
    }
};

// 0, or the errno of the write that failed.
int writeStream(const std::string& path, const openvdb::GridCPtrVec& grids, const openvdb::MetaMap& metadata) {
    std::ofstream stream(path, std::ios::binary);
    try {
        errno = 0;
        stream.exceptions(std::ios::failbit | std::ios::badbit);
        CheckedArchive archive;
        // active voxels alone and as they are: Blosc takes 2 % off their bytes and a third of the speed
        archive.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK);
        archive.writeTo(stream, grids, metadata);
        stream.flush();
        return 0;
    } catch (const std::ios_base::failure&) {
        const int code = errno ? errno : EIO;
        stream.exceptions(std::ios::goodbit);
        return code;
    }
}

openvdb::GridCPtrVec buildGrids(const std::vector<LeafGrid*>& grids) {
    openvdb::GridCPtrVec built;
    for (const LeafGrid* grid : grids) {
        built.push_back(componentsOf(*grid) == 1 ? buildGrid<openvdb::FloatGrid>(*grid)
                                                 : buildGrid<openvdb::Vec3SGrid>(*grid));
    }
    return built;
}

template <typename GridT>
const WrittenRange* rangeOf(const openvdb::GridBase& grid) {
    const auto* streamed = dynamic_cast<const StreamedGrid<GridT>*>(&grid);
    return streamed ? &streamed->written() : nullptr;
}

// Whether the file gives back the bytes of every grid's values.
bool givesBack(const std::string& path, const openvdb::GridCPtrVec& grids) {
    std::ifstream file(path, std::ios::binary);
    std::vector<char> block(kChecked);
    for (const auto& grid : grids) {
        const WrittenRange* range = rangeOf<openvdb::FloatGrid>(*grid);
        if (!range) range = rangeOf<openvdb::Vec3SGrid>(*grid);
        WrittenRange found{range->begin, range->begin};
        file.seekg(range->begin);
        while (found.end < range->end) {
            const auto count = std::min(std::streamoff(block.size()), range->end - found.end);
            if (!file.read(block.data(), count)) return false;
            found.hash = checksum(block.data(), size_t(count), found.hash);
            found.end += count;
        }
        if (found.hash != range->hash) return false;
    }
    return true;
}

// 0, or the errno of the write that failed.
int writeGridsTo(const std::string& path, const std::vector<LeafGrid*>& grids, const openvdb::MetaMap& metadata) {
    const openvdb::GridCPtrVec built = buildGrids(grids);
    const int code = writeStream(path, built, metadata);
    return code == 0 && !givesBack(path, built) ? EIO : code;
}

void checkSame(bool condition, const LeafGrid& grid, const char* what) {
    if (!condition) throw std::runtime_error(grid.name + ": " + what + " differ in the file");
}

// Loads leaf by leaf and lets go of it again; the grid was opened with its values left on the disk.
template <typename GridT>
void compareGrid(const LeafGrid& source, GridT& grid) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    constexpr size_t components = sizeof(ValueT) / sizeof(float);
    const size_t count = source.origins.shape(0);
    checkSame(grid.tree().leafCount() == count && !grid.tree().hasActiveTiles(), source, "leaves");
    tbb::parallel_for(size_t(0), count, [&](size_t i) {
        const int32_t* o = source.origins.data() + 3 * i;
        LeafT* leaf = grid.tree().probeLeaf(openvdb::Coord(o[0], o[1], o[2]));
        checkSame(leaf != nullptr, source, "leaves");
        checkSame(leaf->getValueMask() == maskOf<typename LeafT::NodeMaskType>(source, i), source, "active voxels");
        std::array<float, kLeafVoxels * components> expected;
        fetchValues(source, i, components, expected.data());
        const ValueT* found = const_cast<const LeafT*>(leaf)->buffer().data();
        checkSame(std::memcmp(found, expected.data(), sizeof(expected)) == 0, source, "values");
        typename LeafT::Buffer nothing(openvdb::PartialCreate(), openvdb::zeroVal<ValueT>());
        leaf->swap(nothing);
    });
}

// Raises where the file does not hold exactly these leaves, values, transforms and metadata.
void compareGridsIn(const std::string& path, const std::vector<LeafGrid*>& sources) {
    for (const LeafGrid* source : sources) {
        openvdb::io::File file(path);
        file.setCopyMaxBytes(0);  // map the file itself, never a copy of it in a temporary place
        file.open(true);
        const auto grid = file.readGrid(source->name);
        checkSame(*grid->transformPtr() == *transformOf(*source), *source, "transforms");
        for (auto item = source->metadata.beginMeta(); item != source->metadata.endMeta(); ++item) {
            const auto entry = (*grid)[item->first];
            checkSame(entry && *entry == *item->second, *source, "metadata");
        }
        const bool scalar = componentsOf(*source) == 1;
        checkSame(scalar ? grid->isType<openvdb::FloatGrid>() : grid->isType<openvdb::Vec3SGrid>(), *source, "types");
        if (scalar) {
            compareGrid(*source, static_cast<openvdb::FloatGrid&>(*grid));
        } else {
            compareGrid(*source, static_cast<openvdb::Vec3SGrid&>(*grid));
        }
    }
}

}  // namespace
