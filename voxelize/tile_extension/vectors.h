// How loops over lanes become vectors.
#pragma once

// One copy of a function for each kind of vectors that processors have, chosen when it is loaded; all give the same
// bits, since no operation is joined with another.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12
#define WEFT_FOR_EACH_PROCESSOR __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define WEFT_FOR_EACH_PROCESSOR
#endif

#define WEFT_INLINE inline __attribute__((always_inline))
