// Whole OpenVDB leaf buffers in and out as arrays; the only place that sees OpenVDB.
//
// Arrays: origins (N, 3) int32, multiples of 8; masks (N, 8) uint64, bit (y * 8 + z) of word x; values (N, 512) or
// (N, 512, 3) float32, voxel (x, y, z) at (x * 8 + y) * 8 + z. World position of voxel center (i, j, k):
// voxel_size * (i, j, k) + translation.
#include "leaf_grid.h"
#include "leaf_reader.h"
#include "leaf_stream.h"
#include "leaf_writer.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <variant>

using namespace nb::literals;

namespace {

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

void writeGrids(const std::string& path, const std::vector<LeafGrid*>& grids, const nb::dict& metadata) {
    int code = 0;
    const openvdb::MetaMap fileMetadata = toMetaMap(metadata);
    {
        nb::gil_scoped_release unlocked;
        code = writeGridsTo(path, grids, fileMetadata);
    }
    if (code != 0) {
        errno = code;
        PyErr_SetFromErrnoWithFilename(PyExc_OSError, path.c_str());
        throw nb::python_error();
    }
}

void compareGrids(const std::string& path, const std::vector<LeafGrid*>& grids) {
    nb::gil_scoped_release unlocked;
    compareGridsIn(path, grids);
}

LeafArrays copyAnyLeaves(openvdb::GridBase& grid, Arena& arena, size_t maxLeaves) {
    if (grid.isType<openvdb::FloatGrid>()) return copyLeaves(static_cast<openvdb::FloatGrid&>(grid), arena, maxLeaves);
    if (grid.isType<openvdb::Vec3SGrid>()) return copyLeaves(static_cast<openvdb::Vec3SGrid&>(grid), arena, maxLeaves);
    throw std::invalid_argument(grid.getName() + ": type " + grid.type() + " is neither float nor vec3s");
}

LeafArrays readAnyLeaves(const UnreadFile& archive, const UnreadGrid& unread, const Mapping& file, Arena& arena,
                         size_t maxLeaves) {
    return unread.grid->isType<openvdb::FloatGrid>()
               ? readLeaves<openvdb::FloatGrid>(archive, unread, file, arena, maxLeaves)
               : readLeaves<openvdb::Vec3SGrid>(archive, unread, file, arena, maxLeaves);
}

template <typename T>
nb::object ownedArray(OneArray& array, const std::vector<size_t>& shape) {
    auto* memory = new Mapping(std::move(array.memory));
    nb::capsule owner(memory, [](void* p) noexcept { delete static_cast<Mapping*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(static_cast<T*>(memory->data()), shape.size(), shape.data(), owner));
}

template <typename T>
nb::object ownedArray(std::unique_ptr<T[]> data, const std::vector<size_t>& shape) {
    T* pointer = data.release();
    nb::capsule owner(pointer, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(pointer, shape.size(), shape.data(), owner));
}

nb::dict toArrays(LeafArrays& arrays) {
    std::vector<size_t> shape{arrays.count, kLeafVoxels};
    if (arrays.components == 3) shape.push_back(3);
    nb::dict out;
    out["origins"] = ownedArray<int32_t>(arrays.origins, {arrays.count, 3});
    out["masks"] = ownedArray<uint64_t>(arrays.masks, {arrays.count, 8});
    out["values"] = ownedArray<float>(arrays.values, shape);
    return out;
}

// Where the arrays begin in the file that they were put into, and their shapes.
nb::dict toPlaces(const LeafArrays& arrays) {
    std::vector<size_t> shape{arrays.count, kLeafVoxels};
    if (arrays.components == 3) shape.push_back(3);
    nb::dict out;
    out["origins"] = nb::make_tuple(arrays.origins.offset, nb::make_tuple(arrays.count, 3));
    out["masks"] = nb::make_tuple(arrays.masks.offset, nb::make_tuple(arrays.count, 8));
    out["values"] = nb::make_tuple(arrays.values.offset, shape);
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

// All grids, with empty trees where only their metadata is wanted.
openvdb::GridPtrVec readByLibrary(const std::string& path, bool withLeaves) {
    openvdb::io::File file(path);
    // delayLoad would map the file, or copy it to a temporary place, and read it later.
    file.open(false);
    const openvdb::GridPtrVecPtr all = withLeaves ? file.getGrids() : file.readAllGridMetadata();
    file.close();
    return *all;
}

nb::list readGrids(const std::string& path, size_t maxLeaves, bool withLeaves, int arraysFile) {
    openvdb::GridPtrVec grids;
    std::vector<LeafArrays> arrays;
    Arena arena(arraysFile);
    {
        nb::gil_scoped_release unlocked;
        UnreadFile archive;
        if (withLeaves && archive.open(path)) {
            const Mapping file = mapFile(path);
            for (const UnreadGrid& unread : archive.grids()) {
                grids.push_back(unread.grid);
                arrays.push_back(readAnyLeaves(archive, unread, file, arena, maxLeaves));
            }
        } else {
            grids = readByLibrary(path, withLeaves);
        }
    }
    nb::list out;
    const bool areRead = !arrays.empty();
    for (size_t i = 0; i < grids.size(); ++i) {
        nb::dict entry = describe(*grids[i]);
        const bool isKnown = grids[i]->isType<openvdb::FloatGrid>() || grids[i]->isType<openvdb::Vec3SGrid>();
        // Files of other programs may hold more: of grids of other types name and type alone are passed on.
        if (withLeaves && isKnown) {
            if (!areRead) {
                nb::gil_scoped_release unlocked;
                arrays.push_back(copyAnyLeaves(*grids[i], arena, maxLeaves));
            }
            LeafArrays& leaves = areRead ? arrays[i] : arrays.back();
            grids[i].reset();
            entry[arena.isFile() ? "places" : "leaves"] = arena.isFile() ? toPlaces(leaves) : toArrays(leaves);
        }
        out.append(entry);
    }
    return out;
}

// `sink(origins, values)` for a thousand leaves at a time; what the grid says of itself. (Its transform alone cannot be
// had: readAllGridMetadata rounds it.)
nb::dict streamGrid(const std::string& path, const std::string& name, const nb::callable& sink) {
    const auto hand = [&](LeafBatch batch) {
        const nb::gil_scoped_acquire locked;
        std::vector<size_t> shape{batch.count, kLeafVoxels};
        if (batch.components == 3) shape.push_back(3);
        sink(ownedArray(std::move(batch.origins), {batch.count, 3}), ownedArray(std::move(batch.values), shape));
    };
    openvdb::GridBase::Ptr grid;
    {
        const nb::gil_scoped_release unlocked;
        grid = visitLeaves(path, name, hand);
    }
    return describe(*grid);
}

}  // namespace

NB_MODULE(_openvdb, module) {
    openvdb::initialize();
    module.attr("version") = openvdb::getLibraryVersionString();
    nb::class_<StoredValues>(module, "StoredValues", "Values of leaves that lie in files: the active ones, packed.")
        .def(
            "__init__",
            [](StoredValues* self, std::vector<std::string> paths, FileIndices files, Offsets offsets,
               size_t components) {
                auto open = std::make_shared<OpenFiles>(paths);
                new (self) StoredValues{std::move(paths), files, offsets, components, std::move(open)};
            },
            "paths"_a, "files"_a.noconvert(), "offsets"_a.noconvert(), nb::kw_only(), "components"_a);
    const auto makeLeafGrid = [](LeafGrid* self, std::string name, Origins origins, Masks masks,
                                 std::variant<StoredValues, Values> values, double voxelSize,
                                 std::array<double, 3> translation, std::string gridClass, std::string vectorType,
                                 nb::dict metadata) {
        const StoredValues* stored = std::get_if<StoredValues>(&values);
        new (self) LeafGrid{std::move(name), origins, masks,
                            stored ? std::nullopt : std::optional<Values>(std::get<Values>(values)),
                            stored ? std::optional<StoredValues>(*stored) : std::nullopt, voxelSize, translation,
                            std::move(gridClass), std::move(vectorType), toMetaMap(metadata)};
    };
    nb::class_<LeafGrid>(module, "LeafGrid", "One grid to write: whole leaves as arrays, transform and metadata.")
        .def("__init__", makeLeafGrid, "name"_a, "origins"_a.noconvert(), "masks"_a.noconvert(),
             "values"_a.noconvert(), nb::kw_only(), "voxel_size"_a, "translation"_a, "grid_class"_a = "unknown",
             "vector_type"_a = "invariant", "metadata"_a = nb::dict());
    module.def("write_grids", &writeGrids, "path"_a, "grids"_a, "metadata"_a = nb::dict(),
               "Write all grids into one .vdb file, with metadata of the file.");
    module.def("compare_grids", &compareGrids, "path"_a, "grids"_a,
               "Raise RuntimeError unless the file holds exactly these grids.");
    module.def("read_grids", &readGrids, "path"_a, nb::kw_only(), "max_leaves"_a = kMaxLeaves, "with_leaves"_a = true,
               "arrays_file"_a = -1,
               "All grids of a .vdb file: name, type, metadata, index_to_world (row vectors), and of float and vec3s "
               "grids their leaves sorted by origin. `with_leaves=False` reads no tree. With `arrays_file`, a "
               "descriptor, the leaves are put into that file and `places` says where: offset and shape.");
    module.def("stream_grid", &streamGrid, "path"_a, "name"_a, "sink"_a,
               "Call `sink(origins, values)` for the leaves of one grid, in the order of the file; its name, type, "
               "metadata and index_to_world.");
}
