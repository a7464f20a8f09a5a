// Reading a grid leaf by leaf, in the order of the file: memory for masks and a few thousand leaves.
#pragma once

#include "leaf_grid.h"

#include <openvdb/io/File.h>

#include <functional>

namespace {

// Some leaves as arrays, in the order in which they lie in the file.
struct LeafBatch {
    size_t count = 0;
    size_t components = 1;
    std::unique_ptr<int32_t[]> origins;
    std::unique_ptr<float[]> values;
};

using LeafVisitor = std::function<void(LeafBatch)>;

// A grid that hands its leaves on as they are read, and keeps their masks alone.
template <typename GridT>
class VisitedGrid : public GridT {
    using TreeT = typename GridT::TreeType;
    using LeafT = typename TreeT::LeafNodeType;
    using ValueT = typename GridT::ValueType;

public:
    static inline thread_local const LeafVisitor* visitor = nullptr;

    // In the place of GridT.
    static void enlist() { openvdb::GridBase::registerGrid(GridT::gridType(), &VisitedGrid::make); }

    void readBuffers(std::istream& is) override {
        requireThat(!this->tree().hasActiveTiles(), this->getName() + ": has tiles");
        std::vector<LeafT*> leaves;
        leaves.reserve(this->tree().leafCount());
        this->tree().getNodes(leaves);
        for (size_t begin = 0; begin < leaves.size(); begin += kLeavesAtOnce) {
            const size_t count = std::min(kLeavesAtOnce, leaves.size() - begin);
            (*visitor)(readLeaves(is, leaves.data() + begin, count));
        }
    }

private:
    static openvdb::GridBase::Ptr make() { return openvdb::GridBase::Ptr(new VisitedGrid); }

    LeafBatch readLeaves(std::istream& is, LeafT** leaves, size_t count) {
        constexpr size_t components = sizeof(ValueT) / sizeof(float);
        LeafBatch batch{count, components, std::unique_ptr<int32_t[]>(new int32_t[count * 3]),
                        std::unique_ptr<float[]>(new float[count * kLeafVoxels * components])};
        for (size_t i = 0; i < count; ++i) {
            LeafT& leaf = *leaves[i];
            leaf.readBuffers(is, this->saveFloatAsHalf());
            if (!is) throw std::runtime_error(this->getName() + ": the file ends too early");
            for (int axis = 0; axis < 3; ++axis) batch.origins[3 * i + axis] = leaf.origin()[axis];
            std::memcpy(batch.values.get() + i * kLeafVoxels * components, leaf.buffer().data(),
                        kLeafVoxels * sizeof(ValueT));
            typename LeafT::Buffer nothing(openvdb::PartialCreate(), openvdb::zeroVal<ValueT>());
            leaf.swap(nothing);
        }
        return batch;
    }
};

// While it lives, files are read into visited grids of this type.
template <typename GridT>
class VisitedType {
public:
    explicit VisitedType(const LeafVisitor& visitor) {
        VisitedGrid<GridT>::visitor = &visitor;
        GridT::unregisterGrid();
        VisitedGrid<GridT>::enlist();
    }
    ~VisitedType() {
        GridT::unregisterGrid();
        GridT::registerGrid();
        VisitedGrid<GridT>::visitor = nullptr;
    }
    VisitedType(const VisitedType&) = delete;
    VisitedType& operator=(const VisitedType&) = delete;
};

openvdb::GridBase::Ptr visitLeaves(const std::string& path, const std::string& name, const LeafVisitor& visitor) {
    const VisitedType<openvdb::FloatGrid> floats(visitor);
    const VisitedType<openvdb::Vec3SGrid> vectors(visitor);
    openvdb::io::File file(path);
    file.open(false);
    const openvdb::GridBase::Ptr grid = file.readGrid(name);
    file.close();
    return grid;
}

}  // namespace
