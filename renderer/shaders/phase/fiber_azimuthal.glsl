// Azimuthal lobes N of the fiber phase function; lobe = (kind, gamma, scale, slope) from renderer/scattering_block.py:
// 0 uniform, 1 and 2 wrapped normal, 3 von Mises with kappa = 1/gamma^2; 4, a table, is fiber_azimuthal_table.glsl's.
// Twin: fiber_model/scattering/azimuthal.py
#include "math/constants.glsl"
#include "math/arctangent.glsl"
#include "rng/random.glsl"

// Density at the angle phi in [0, pi] from the lobe's center.
float fiber_azimuthal_eval(vec4 lobe, float phi) {
    if (lobe.x == 1.0) {
        // three images of the Gaussian: gamma <= 1.4
        vec3 z = vec3(phi, TWO_PI - phi, TWO_PI + phi) / lobe.y;
        vec3 images = exp(-0.5 * z * z);
        return lobe.z * (images.x + images.y + images.z);
    }
    if (lobe.x == 2.0) {
        // Fourier series, coefficients q^(n^2) with q = exp(-gamma^2/2)
        float q = lobe.z;
        float q4 = q * q * q * q;
        float c = cos(phi);
        float c2 = 2.0 * c * c - 1.0;
        float waves = q * c + q4 * c2 + q4 * q4 * q * c * (2.0 * c2 - 1.0) + q4 * q4 * q4 * q4 * (2.0 * c2 * c2 - 1.0);
        return INV_TWO_PI * (1.0 + 2.0 * waves);
    }
    if (lobe.x == 3.0) {
        float half_sine = sin(0.5 * phi);
        return lobe.z * exp(-2.0 * half_sine * half_sine / (lobe.y * lobe.y));
    }
    return INV_TWO_PI;
}

// Angle from the lobe's center for the kinds that need no rejection.
float fiber_azimuthal_sample(vec4 lobe, vec2 u) {
    return lobe.x == 0.0 ? TWO_PI * u.x : lobe.y * standard_normals(u).x;
}

// One try at the von Mises lobe under the wrapped Cauchy envelope (Best and Fisher 1979); acceptance 0.66 to 1.
// With w = tan(phi/2) and d = 1 - cos(phi), the target over the envelope is exp(-kappa d) (slope^2 + (1 - slope^2) d/2).
bool fiber_von_mises_try(vec4 lobe, vec2 u, inout float phi) {
    float kappa = 1.0 / (lobe.y * lobe.y);
    float slope2 = lobe.w * lobe.w;
    float w = lobe.w * tan(PI * (u.x - 0.5));
    float drop = 2.0 - 2.0 / (1.0 + w * w);
    float growth = 0.5 * (1.0 - slope2);
    float best = clamp(1.0 / kappa - slope2 / growth, 0.0, 2.0);
    bool accepted = u.y < exp(-kappa * (drop - best)) * (slope2 + growth * drop) / (slope2 + growth * best);
    phi = accepted ? 2.0 * arctangent(w, 1.0) : phi;
    return accepted;
}
