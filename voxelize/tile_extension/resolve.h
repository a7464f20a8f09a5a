// Density and direction of bricks from their sums.
#pragma once

#include "tile_sums.h"

namespace weft {

// Where the values of brick i go; the moments are left out where null.
struct BrickValues {
    float* density;
    float* direction;
    float* momentDiag;
    float* momentOff;
};

// Twin: kernels.resolve_bricks. The bricks' sums are clear afterwards.
void resolveBricks(TileSums& tile, const int32_t* bricks, size_t count, double densityPerUnit,
                   const BrickValues& values);

}  // namespace weft
