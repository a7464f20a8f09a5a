// Segments into the sums of a tile, and bricks out of them: kernels.py, its twin with the same bits, for the CPU.
#include "accumulate.h"
#include "resolve.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

#include <array>
#include <optional>
#include <stdexcept>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Points = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const uint8_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Offsets = nb::ndarray<const float, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Scalars = nb::ndarray<float, nb::shape<-1, 512>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using Masks = nb::ndarray<const uint64_t, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;
using Packed = nb::ndarray<float, nb::c_contig, nb::device::cpu>;
using Vectors = nb::ndarray<float, nb::shape<-1, 512, 3>, nb::c_contig, nb::device::cpu>;

void requireThat(bool condition, const char* message) {
    if (!condition) throw std::invalid_argument(message);
}

// Where a tile lies; keeps the offsets of its lines.
struct TilePlace {
    weft::Placement placement;
    Offsets offsets;
};

void checkList(const Points& points, const Flags& flags, size_t stride, const std::optional<Numbers>& order) {
    requireThat(stride == 1 || stride == 2, "stride is neither 1 nor 2");
    const size_t most = points.shape(0) < 2 ? 0 : (points.shape(0) - 2) / stride + 1;  // segments with both ends
    if (!order) {
        requireThat(flags.shape(0) <= most + (stride == 1 ? 1 : 0), "more flags than segments");
        requireThat(flags.shape(0) <= most || flags.data()[most] == 0, "the last point begins no segment");
        return;
    }
    requireThat(flags.shape(0) == order->shape(0), "flags and order differ in length");
    for (size_t i = 0; i < order->shape(0); ++i) {
        requireThat(order->data()[i] >= 0 && size_t(order->data()[i]) < most, "order names a segment that is not there");
    }
}

int64_t add(weft::TileSums& tile, const TilePlace& place, const Points& points, const Flags& flags, size_t stride,
            const std::optional<Numbers>& order) {
    nb::gil_scoped_release unlocked;
    checkList(points, flags, stride, order);
    for (int k = 0; k < 3; ++k) {
        const weft::Box& box = place.placement.box;
        requireThat(box.low[k] >= box.origin[k] && box.high[k] - box.origin[k] <= tile.bricksPerSide() * 8,
                    "the box reaches beyond the tile");
    }
    return weft::addSegments(tile, place.placement,
                             {points.data(), flags.data(), order ? order->data() : nullptr, flags.shape(0), stride});
}

void resolve(weft::TileSums& tile, const Numbers& bricks, double densityPerUnit, const Scalars& density,
             const Vectors& direction, const std::optional<Vectors>& diag, const std::optional<Vectors>& off) {
    nb::gil_scoped_release unlocked;
    const size_t count = bricks.shape(0);
    requireThat(density.shape(0) == count && direction.shape(0) == count && diag.has_value() == off.has_value() &&
                    (!diag || (diag->shape(0) == count && off->shape(0) == count)),
                "bricks and values differ in length");
    for (size_t i = 0; i < count; ++i) {
        requireThat(bricks.data()[i] >= 0 && size_t(bricks.data()[i]) < tile.brickCount(), "no such brick");
    }
    weft::resolveBricks(tile, bricks.data(), count, densityPerUnit,
                        {density.data(), direction.data(), diag ? diag->data() : nullptr, off ? off->data() : nullptr});
}

// The values of active voxels, one after the other.
void pack(const Values& values, const Masks& masks, const Packed& packed) {
    nb::gil_scoped_release unlocked;
    const size_t count = masks.shape(0), width = values.size() / (count * 512 + (count == 0));
    requireThat(values.size() == count * 512 * width && (width == 1 || width == 3 || count == 0),
                "values are not those of the masks' bricks");
    const uint64_t* words = masks.data();
    size_t active = 0;
    for (size_t i = 0; i < count * 8; ++i) active += size_t(__builtin_popcountll(words[i]));
    requireThat(packed.size() == active * width, "packed values are not as many as active voxels");
    float* out = packed.data();
    for (size_t i = 0; i < count * 8; ++i) {
        const float* word = values.data() + i * 64 * width;
        for (uint64_t left = words[i]; left; left &= left - 1) {
            const float* value = word + size_t(__builtin_ctzll(left)) * width;
            for (size_t k = 0; k < width; ++k) *out++ = value[k];
        }
    }
}

nb::object usedOf(nb::handle self) {
    auto& tile = nb::cast<weft::TileSums&>(self);
    return nb::cast(nb::ndarray<nb::numpy, uint8_t, nb::shape<-1>>(tile.used(), {tile.brickCount()}, self));
}

}  // namespace

NB_MODULE(_tiles, module) {
    using Corner = std::array<int32_t, 3>;
    using Point = std::array<double, 3>;
    const auto makePlace = [](TilePlace* self, Corner origin, Corner low, Corner high, float inverseSize, float scale,
                              Offsets offsets, Point regionLow, Point regionHigh) {
        requireThat(offsets.shape(0) > 0, "a fiber needs a line");
        new (self) TilePlace{{}, offsets};
        weft::Placement& place = self->placement;
        for (int k = 0; k < 3; ++k) {
            place.box.origin[k] = origin[k];
            place.box.low[k] = low[k];
            place.box.high[k] = high[k];
            place.regionLow[k] = regionLow[k];
            place.regionHigh[k] = regionHigh[k];
        }
        place.inverseSize = inverseSize;
        place.scale = scale;
        place.offsets = offsets.data();
        place.lineCount = offsets.shape(0);
    };
    nb::class_<TilePlace>(module, "TilePlace", "Where a tile lies, and what stands for a fiber.")
        .def("__init__", makePlace, "origin"_a, "low"_a, "high"_a, "inverse_size"_a, "scale"_a,
             "offsets"_a.noconvert(), "region_low"_a, "region_high"_a);
    module.def("pack", &pack, "values"_a.noconvert(), "masks"_a.noconvert(), "packed"_a.noconvert(),
               "Write the values of active voxels one after the other.");
    nb::class_<weft::TileSums>(module, "TileSums", "The sums of one tile of so many bricks along the edge.")
        .def(nb::init<int32_t>(), "bricks_per_side"_a)
        .def("add", &add, "place"_a, "points"_a.noconvert(), "flags"_a.noconvert(), "stride"_a,
             "order"_a.noconvert() = nb::none(), "Add segments; the length of those to be measured, in 2^-32 mm.")
        .def("resolve", &resolve, "bricks"_a.noconvert(), "density_per_unit"_a, "density"_a.noconvert(),
             "direction"_a.noconvert(), "moment_diag"_a.noconvert() = nb::none(),
             "moment_off"_a.noconvert() = nb::none(), "Write bricks out; their sums are clear afterwards.")
        .def_prop_ro("used", [](nb::handle self) { return usedOf(self); }, "1 for each brick with fiber, uint8.");
}
