// Dye absorbs inside of the fiber: `tint` is what it leaves of light that crosses once, so TT is multiplied by it and
// TRT, which crosses twice, by its square; R never enters the fiber and stays as it is. Chances of the lobes follow.
void dye(inout FiberScattering s, vec3 tint) {
#if VOXEL_COLORS
    s.energy_tt.rgb *= tint;
    s.energy_trt.rgb *= tint * tint;
#endif
}
