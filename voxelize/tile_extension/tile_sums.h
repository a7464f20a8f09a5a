// The sums of one tile: 32 bits a number while a voxel holds little, 64 bits for what goes beyond.
#pragma once

#include "segment_walk.h"

#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <vector>

#include <sys/mman.h>

namespace weft {

constexpr int32_t kBrickVoxels = 512;
// A voxel whose length passes this is emptied into 64 bits. A piece is at most 2^28 (four voxel lengths), and no
// other sum is larger than the length, so nothing overflows.
constexpr int32_t kFull = 1 << 30;

class TileSums {
public:
    explicit TileSums(int32_t bricksPerSide)
        : mBricksPerSide(bricksPerSide),
          mUsed(size_t(bricksPerSide) * bricksPerSide * bricksPerSide, 0),
          mLarge(mUsed.size()) {
        mBytes = mUsed.size() * kBrickVoxels * kSums * sizeof(int32_t);
        // zero pages cost nothing until fibers reach their brick
        void* pages = ::mmap(nullptr, mBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (pages == MAP_FAILED) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE
        ::madvise(pages, mBytes, MADV_HUGEPAGE);
#endif
        mSums = static_cast<int32_t*>(pages);
    }
    ~TileSums() { ::munmap(mSums, mBytes); }
    TileSums(const TileSums&) = delete;
    TileSums& operator=(const TileSums&) = delete;

    int32_t bricksPerSide() const { return mBricksPerSide; }
    int32_t* sums() { return mSums; }
    uint8_t* used() { return mUsed.data(); }
    size_t brickCount() const { return mUsed.size(); }
    const int64_t* large(size_t brick) const { return mLarge[brick].get(); }

    // Move a voxel's sums to 64 bits.
    void empty(int32_t place) {
        std::unique_ptr<int64_t[]>& brick = mLarge[size_t(place) / kBrickVoxels];
        if (!brick) brick = std::make_unique<int64_t[]>(size_t(kBrickVoxels) * kSums);
        int32_t* from = mSums + size_t(place) * kSums;
        int64_t* to = brick.get() + size_t(place % kBrickVoxels) * kSums;
        for (int k = 0; k < kSums; ++k) {
            to[k] += from[k];
            from[k] = 0;
        }
    }

    // Ready for the next tile.
    void clear(size_t brick) {
        std::memset(mSums + brick * kBrickVoxels * kSums, 0, kBrickVoxels * kSums * sizeof(int32_t));
        mLarge[brick].reset();
        mUsed[brick] = 0;
    }

private:
    int32_t mBricksPerSide;
    int32_t* mSums = nullptr;
    size_t mBytes = 0;
    std::vector<uint8_t> mUsed;
    std::vector<std::unique_ptr<int64_t[]>> mLarge;
};

}  // namespace weft
