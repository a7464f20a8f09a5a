// Whole OpenVDB leaf buffers in and out as arrays; the only place that sees OpenVDB.
//
// Arrays: origins (N, 3) int32, multiples of 8; masks (N, 8) uint64, bit (y * 8 + z) of word x; values (N, 512) or
// (N, 512, 3) float32, voxel (x, y, z) at (x * 8 + y) * 8 + z. World position of voxel center (i, j, k):
// voxel_size * (i, j, k) + translation.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <openvdb/openvdb.h>
#include <openvdb/io/File.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr size_t kLeafVoxels = 512;
constexpr int32_t kLeafSize = 8;
constexpr int32_t kCoordinateLimit = 1 << 30;
constexpr size_t kMaxLeaves = size_t(1) << 26;

using Origins = nb::ndarray<const int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Masks = nb::ndarray<const uint64_t, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;

// One grid to write. It keeps the arrays alive, so the leaves can be built without the GIL.
struct LeafGrid {
    std::string name;
    Origins origins;
    Masks masks;
    Values values;
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

void checkShapes(const LeafGrid& grid, size_t components) {
    const size_t count = grid.origins.shape(0);
    requireThat(count <= kMaxLeaves, grid.name + ": more than 2^26 leaves");
    requireThat(grid.masks.shape(0) == count && grid.values.shape(0) == count,
                grid.name + ": origins, masks and values differ in length");
    requireThat(grid.values.shape(1) == kLeafVoxels, grid.name + ": values hold not 512 voxels per leaf");
    requireThat(components == 1 || grid.values.shape(2) == 3, grid.name + ": vectors have not 3 components");
    requireThat(grid.voxelSize > 0 && std::isfinite(grid.voxelSize), grid.name + ": voxel size is not positive");
}

openvdb::math::Transform::Ptr transformOf(const LeafGrid& source) {
    auto transform = openvdb::math::Transform::createLinearTransform(source.voxelSize);
    transform->postTranslate(openvdb::Vec3d(source.translation[0], source.translation[1], source.translation[2]));
    return transform;
}

template <typename GridT>
openvdb::GridBase::Ptr buildGrid(const LeafGrid& source) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    static_assert(sizeof(ValueT) % sizeof(float) == 0 && LeafT::SIZE == kLeafVoxels, "unexpected leaf layout");
    constexpr size_t components = sizeof(ValueT) / sizeof(float);
    checkShapes(source, components);
    const size_t count = source.origins.shape(0);
    const int32_t* origins = source.origins.data();
    checkOrigins(source.name, origins, count);

    std::vector<std::unique_ptr<LeafT>> leaves(count);
    tbb::parallel_for(size_t(0), count, [&](size_t i) {
        const int32_t* o = origins + 3 * i;
        auto leaf = std::make_unique<LeafT>(openvdb::Coord(o[0], o[1], o[2]), openvdb::zeroVal<ValueT>(), false);
        typename LeafT::NodeMaskType mask;
        for (uint32_t word = 0; word < 8; ++word) mask.template getWord<uint64_t>(word) = source.masks.data()[8 * i + word];
        leaf->setValueMask(mask);
        std::memcpy(leaf->buffer().data(), source.values.data() + i * kLeafVoxels * components,
                    kLeafVoxels * sizeof(ValueT));
        leaves[i] = std::move(leaf);
    });

    auto grid = GridT::create(openvdb::zeroVal<ValueT>());
    for (auto& leaf : leaves) grid->tree().addLeaf(leaf.release());
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
    if (components == 3) grid->setVectorType(vectorType);
    return grid;
}

openvdb::MetaMap toMetaMap(const nb::dict& values) {
    openvdb::MetaMap map;
    for (auto [key, value] : values) {
        const auto name = nb::cast<std::string>(key);
        if (nb::isinstance<nb::bool_>(value)) {
            map.insertMeta(name, openvdb::BoolMetadata(nb::cast<bool>(value)));
        } else if (nb::isinstance<nb::int_>(value)) {
            map.insertMeta(name, openvdb::Int64Metadata(nb::cast<int64_t>(value)));
        } else if (nb::isinstance<nb::float_>(value)) {
            map.insertMeta(name, openvdb::DoubleMetadata(nb::cast<double>(value)));
        } else {
            map.insertMeta(name, openvdb::StringMetadata(nb::cast<std::string>(value)));
        }
    }
    return map;
}

nb::dict fromMetaMap(const openvdb::MetaMap& map) {
    nb::dict values;
    for (auto item = map.beginMeta(); item != map.endMeta(); ++item) {
        const openvdb::Metadata& entry = *item->second;
        const std::string type = entry.typeName();
        const char* name = item->first.c_str();
        if (type == openvdb::BoolMetadata::staticTypeName()) {
            values[name] = static_cast<const openvdb::BoolMetadata&>(entry).value();
        } else if (type == openvdb::Int32Metadata::staticTypeName()) {
            values[name] = static_cast<const openvdb::Int32Metadata&>(entry).value();
        } else if (type == openvdb::Int64Metadata::staticTypeName()) {
            values[name] = static_cast<const openvdb::Int64Metadata&>(entry).value();
        } else if (type == openvdb::FloatMetadata::staticTypeName()) {
            values[name] = static_cast<const openvdb::FloatMetadata&>(entry).value();
        } else if (type == openvdb::DoubleMetadata::staticTypeName()) {
            values[name] = static_cast<const openvdb::DoubleMetadata&>(entry).value();
        } else {
            // Metadata of an untrusted file may hold any bytes.
            const std::string text = entry.str();
            values[name] = nb::steal(PyUnicode_DecodeUTF8(text.data(), Py_ssize_t(text.size()), "replace"));
        }
    }
    return values;
}

// io::File::write does not notice a stream that fails; this does.
class CheckedArchive : public openvdb::io::Archive {
public:
    void writeTo(std::ostream& stream, const openvdb::GridCPtrVec& grids) const { write(stream, grids, true); }
};

// 0, or the errno of the write that failed.
int writeStream(const std::string& path, const openvdb::GridCPtrVec& grids) {
    std::ofstream stream(path, std::ios::binary);
    try {
        errno = 0;
        stream.exceptions(std::ios::failbit | std::ios::badbit);
        CheckedArchive().writeTo(stream, grids);
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
        requireThat(grid->values.ndim() == 2 || grid->values.ndim() == 3, grid->name + ": values have 2 or 3 axes");
        built.push_back(grid->values.ndim() == 2 ? buildGrid<openvdb::FloatGrid>(*grid)
                                                 : buildGrid<openvdb::Vec3SGrid>(*grid));
    }
    return built;
}

void writeGrids(const std::string& path, const std::vector<LeafGrid*>& grids) {
    int code = 0;
    {
        nb::gil_scoped_release unlocked;
        code = writeStream(path, buildGrids(grids));
    }
    if (code != 0) {
        errno = code;
        PyErr_SetFromErrnoWithFilename(PyExc_OSError, path.c_str());
        throw nb::python_error();
    }
}

void checkSame(bool condition, const LeafGrid& grid, const char* what) {
    if (!condition) throw std::runtime_error(grid.name + ": " + what + " differ in the file");
}

template <typename GridT>
void compareGrid(const LeafGrid& source, const GridT& grid) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    constexpr size_t components = sizeof(ValueT) / sizeof(float);
    const size_t count = source.origins.shape(0);
    checkSame(grid.tree().leafCount() == count && !grid.tree().hasActiveTiles(), source, "leaves");
    tbb::parallel_for(size_t(0), count, [&](size_t i) {
        const int32_t* o = source.origins.data() + 3 * i;
        const LeafT* leaf = grid.tree().probeConstLeaf(openvdb::Coord(o[0], o[1], o[2]));
        checkSame(leaf != nullptr, source, "leaves");
        for (uint32_t word = 0; word < 8; ++word) {
            checkSame(leaf->getValueMask().template getWord<uint64_t>(word) == source.masks.data()[8 * i + word],
                      source, "active voxels");
        }
        checkSame(std::memcmp(leaf->buffer().data(), source.values.data() + i * kLeafVoxels * components,
                              kLeafVoxels * sizeof(ValueT)) == 0,
                  source, "values");
    });
}

// Raises where the file does not hold exactly these leaves, values, transforms and metadata.
void compareGrids(const std::string& path, const std::vector<LeafGrid*>& sources) {
    nb::gil_scoped_release unlocked;
    openvdb::io::File file(path);
    file.open(false);
    for (const LeafGrid* source : sources) {
        const auto grid = file.readGrid(source->name);
        checkSame(*grid->transformPtr() == *transformOf(*source), *source, "transforms");
        for (auto item = source->metadata.beginMeta(); item != source->metadata.endMeta(); ++item) {
            const auto entry = (*grid)[item->first];
            checkSame(entry && *entry == *item->second, *source, "metadata");
        }
        const bool scalar = source->values.ndim() == 2;
        checkSame(scalar ? grid->isType<openvdb::FloatGrid>() : grid->isType<openvdb::Vec3SGrid>(), *source, "types");
        if (scalar) {
            compareGrid(*source, static_cast<const openvdb::FloatGrid&>(*grid));
        } else {
            compareGrid(*source, static_cast<const openvdb::Vec3SGrid&>(*grid));
        }
    }
    file.close();
}

template <typename T>
nb::object ownedArray(std::unique_ptr<T[]> data, const std::vector<size_t>& shape) {
    T* pointer = data.release();
    nb::capsule owner(pointer, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(pointer, shape.size(), shape.data(), owner));
}

// The leaves of a grid as arrays, made without the GIL.
struct LeafArrays {
    size_t count = 0;
    size_t components = 1;
    std::unique_ptr<int32_t[]> origins;
    std::unique_ptr<uint64_t[]> masks;
    std::unique_ptr<float[]> values;
};

template <typename GridT>
LeafArrays copyLeaves(GridT& grid, size_t maxLeaves) {
    using LeafT = typename GridT::TreeType::LeafNodeType;
    using ValueT = typename GridT::ValueType;
    constexpr size_t components = sizeof(ValueT) / sizeof(float);
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
    LeafArrays arrays;
    arrays.count = leaves.size();
    arrays.components = components;
    arrays.origins.reset(new int32_t[arrays.count * 3]);
    arrays.masks.reset(new uint64_t[arrays.count * 8]);
    arrays.values.reset(new float[arrays.count * kLeafVoxels * components]);
    tbb::parallel_for(size_t(0), arrays.count, [&](size_t i) {
        const LeafT& leaf = *leaves[i];
        for (int axis = 0; axis < 3; ++axis) arrays.origins[3 * i + axis] = leaf.origin()[axis];
        for (uint32_t word = 0; word < 8; ++word) {
            arrays.masks[8 * i + word] = leaf.getValueMask().template getWord<uint64_t>(word);
        }
        std::memcpy(arrays.values.get() + i * kLeafVoxels * components, leaf.buffer().data(),
                    kLeafVoxels * sizeof(ValueT));
    });
    return arrays;
}

LeafArrays copyAnyLeaves(openvdb::GridBase& grid, size_t maxLeaves) {
    if (grid.isType<openvdb::FloatGrid>()) return copyLeaves(static_cast<openvdb::FloatGrid&>(grid), maxLeaves);
    if (grid.isType<openvdb::Vec3SGrid>()) return copyLeaves(static_cast<openvdb::Vec3SGrid&>(grid), maxLeaves);
    throw std::invalid_argument(grid.getName() + ": type " + grid.type() + " is neither float nor vec3s");
}

nb::object toArrays(LeafArrays& arrays) {
    std::vector<size_t> shape{arrays.count, kLeafVoxels};
    if (arrays.components == 3) shape.push_back(3);
    nb::dict out;
    out["origins"] = ownedArray(std::move(arrays.origins), {arrays.count, 3});
    out["masks"] = ownedArray(std::move(arrays.masks), {arrays.count, 8});
    out["values"] = ownedArray(std::move(arrays.values), shape);
    return out;
}

nb::dict describe(const openvdb::GridBase& grid) {
    nb::dict out = fromMetaMap(grid);
    nb::dict all;
    all["name"] = grid.getName();
    all["type"] = grid.type();
    all["metadata"] = out;
    std::vector<double> matrix;
    if (grid.transform().isLinear()) {
        const openvdb::Mat4d m = grid.transform().baseMap()->getAffineMap()->getMat4();
        // Row vectors times matrix, as OpenVDB has it: the translation is the last row.
        matrix.assign(m.asPointer(), m.asPointer() + 16);
    }
    all["index_to_world"] = matrix;
    return all;
}

nb::list readGrids(const std::string& path, size_t maxLeaves, bool withLeaves) {
    openvdb::GridPtrVec grids;
    {
        nb::gil_scoped_release unlocked;
        openvdb::io::File file(path);
        // delayLoad would map the file, or copy it to a temporary place, and read it later.
        file.open(false);
        const openvdb::GridPtrVecPtr all = withLeaves ? file.getGrids() : file.readAllGridMetadata();
        grids = *all;
        file.close();
    }
    nb::list out;
    for (auto& grid : grids) {
        nb::dict entry = describe(*grid);
        if (withLeaves) {
            LeafArrays arrays;
            {
                nb::gil_scoped_release unlocked;
                arrays = copyAnyLeaves(*grid, maxLeaves);
                grid.reset();
            }
            entry["leaves"] = toArrays(arrays);
        }
        out.append(entry);
    }
    return out;
}

}  // namespace

NB_MODULE(_openvdb, module) {
    openvdb::initialize();
    module.attr("version") = openvdb::getLibraryVersionString();
    nb::class_<LeafGrid>(module, "LeafGrid", "One grid to write: whole leaves as arrays, transform and metadata.")
        .def(
            "__init__",
            [](LeafGrid* self, std::string name, Origins origins, Masks masks, Values values, double voxelSize,
               std::array<double, 3> translation, std::string gridClass, std::string vectorType, nb::dict metadata) {
                new (self) LeafGrid{std::move(name), origins, masks, values, voxelSize, translation,
                                    std::move(gridClass), std::move(vectorType), toMetaMap(metadata)};
            },
            "name"_a, "origins"_a.noconvert(), "masks"_a.noconvert(), "values"_a.noconvert(), nb::kw_only(), "voxel_size"_a, "translation"_a,
            "grid_class"_a = "unknown", "vector_type"_a = "invariant", "metadata"_a = nb::dict());
    module.def("write_grids", &writeGrids, "path"_a, "grids"_a, "Write all grids into one .vdb file.");
    module.def("compare_grids", &compareGrids, "path"_a, "grids"_a,
               "Raise RuntimeError unless the file holds exactly these grids.");
    module.def("read_grids", &readGrids, "path"_a, nb::kw_only(), "max_leaves"_a = kMaxLeaves, "with_leaves"_a = true,
               "All grids of a .vdb file: name, type, metadata, index_to_world (row vectors), and their leaves sorted "
               "by origin. `with_leaves=False` reads no tree.");
}
