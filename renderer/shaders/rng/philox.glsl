// Philox4x32-10 (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3"); the check on pcg4d.
void philox_round(inout uvec4 counter, inout uvec2 key) {
    uint high0;
    uint low0;
    uint high1;
    uint low1;
    umulExtended(0xD2511F53u, counter.x, high0, low0);
    umulExtended(0xCD9E8D57u, counter.z, high1, low1);
    counter = uvec4(high1 ^ counter.y ^ key.x, low1, high0 ^ counter.w ^ key.y, low0);
    key += uvec2(0x9E3779B9u, 0xBB67AE85u);
}

uvec4 philox4x32(uvec4 counter, uvec2 key) {
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    philox_round(counter, key);
    return counter;
}
