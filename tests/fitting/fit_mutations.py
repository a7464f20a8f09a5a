"""Faults to inject into the fit, each with a test that must turn red (test_fit_mutations.py)."""

from __future__ import annotations

from tests.faults import Mutation

FIT = "tests/fitting/test_fit.py::"
SOLVE = "tests/fitting/test_solve.py::"
NAMED = "tests/fitting/test_identifiability.py::"
AMPLITUDES = "tests/fitting/test_amplitudes.py::"
JAX = "tests/fiber_model/scattering/test_phase_jax.py::"
MATERIALS = "tests/fitting/test_materials.py::test_a_trilobal_fiber_s_light_lies_around_it_as_the_preset_says"

MUTATIONS = (
    Mutation(
        "the wrong sign of a slope",
        "fitting/residuals.py",
        "return data.weights * (transformed[0] - transformed[1])",
        "return data.weights * (2 * jax.lax.stop_gradient(transformed[0]) - transformed[0] - transformed[1])",
        SOLVE + "test_the_jacobian_of_the_polish_equals_finite_differences",
    ),
    Mutation(
        "steps uphill",
        "fitting/projected.py",
        "-gradient / size * moving)",
        "gradient / size * moving)",
        SOLVE + "test_polish_stops_at_a_bound_where_the_gradient_points_outward",
    ),
    Mutation(
        "a bound ignored",
        "fitting/projected.py",
        "x = jnp.clip(_moved(state.x, delta), p.lower, p.upper)",
        "x = _moved(state.x, delta)",
        SOLVE + "test_polish_stops_at_a_bound_where_the_gradient_points_outward",
    ),
    Mutation(
        "amplitudes 2 % high",
        "fitting/amplitudes.py",
        "return solution(subsets[best]) / size",
        "return 1.02 * solution(subsets[best]) / size",
        AMPLITUDES + "test_exact_values_give_the_energies_back",
    ),
    Mutation(
        "weights squared twice",
        "fitting/amplitudes.py",
        "squared = data.weights**2",
        "squared = data.weights**4",
        AMPLITUDES + "test_what_is_left_is_orthogonal_to_what_is_free",
    ),
    Mutation(
        "negative amplitudes",
        "fitting/amplitudes.py",
        "jnp.where((a < -1e-12).any(), jnp.inf,",
        "jnp.where(False, jnp.inf,",
        AMPLITUDES + "test_no_amplitude_is_negative",
    ),
    Mutation(
        "held-out angles in the fit",
        "fitting/selection.py",
        "return take(measurements, kept & ~held),",
        "return take(measurements, kept),",
        FIT + "test_held_out_angle_is_not_seen_and_its_error_told",
    ),
    Mutation(
        "masks without effect",
        "fitting/selection.py",
        "kept = usable(measurements) & ~np.any(",
        "kept = usable(measurements) | ~np.any(",
        FIT + "test_mask_leaves_directions_out",
    ),
    Mutation(
        "a degeneracy not named",
        "fitting/identifiability.py",
        "True, known.remedy) for row in new]",
        "True, known.remedy) for row in new[1:]]",
        NAMED + "test_transmitted_energy_is_named",
    ),
    Mutation(
        "a default tie forgotten",
        "fitting/parameterization.py",
        "    if not config.brightest_tt:",
        "    if False:",
        NAMED + "test_default_ties_leave_nothing_undetermined",
    ),
    Mutation(
        "sigma off by the root of two",
        "fitting/noise.py",
        "result[:count] = 1 / (sigma * slope)",
        "result[:count] = np.sqrt(2) / (sigma * slope)",
        FIT + "test_chi_square_is_about_one_per_degree_of_freedom",
    ),
    Mutation(
        "the seed ignored",
        "fitting/solve.py",
        "seed=np.random.default_rng(seed))",
        "seed=np.random.default_rng(0))",
        SOLVE + "test_starts_follow_the_seed",
    ),
    Mutation(
        "the clock as seed",
        "fitting/solve.py",
        "seed=np.random.default_rng(seed))",
        "seed=np.random.default_rng())",
        SOLVE + "test_starts_follow_the_seed",
    ),
    Mutation(
        "standard errors too small by the root of two",
        "fitting/uncertainty.py",
        "(v @ inner @ v.T) / np.outer(size, size)",
        "(v @ inner @ v.T) / (2 * np.outer(size, size))",
        FIT + "test_intervals_agree_with_the_covariance_where_the_data_are_good[profile]",
    ),
    Mutation(
        "outliers not held back",
        "fitting/residuals.py",
        "jnp.sign(r) * jnp.sqrt(limit * (2 * far - limit))",
        "r",
        FIT + "test_robust_loss_holds_back_outliers[huber]",
    ),
    Mutation(
        "the power of a tie ignored",
        "fitting/parameterization.py",
        "tied**parameterization.tie_power",
        "tied",
        FIT + "test_noise_free_values_give_the_parameters_back",
    ),
    Mutation(
        "tables not normalized on JAX",
        "fiber_model/scattering/phase_jax.py",
        "densities = table / (table @ knot_masses(knots))[:, None]",
        "densities = table",
        JAX + "test_equals_numpy[table rows]",
    ),
    Mutation(
        "tables turned around",
        "fiber_model/scattering/phase.py",
        "CENTERS = (0.0, np.pi, 0.0, 0.0)",
        "CENTERS = (0.0, np.pi, np.pi, 0.0)",
        MATERIALS,
    ),
    Mutation(
        "tables blind to the inclination of the light",
        "fiber_model/scattering/azimuthal_table.py",
        "place = (rows - 1) * (1 - np.minimum(np.asarray(cos_o, dtype=np.float64), 1.0))",
        "place = (rows - 1) * (1 + 0 * np.minimum(np.asarray(cos_o, dtype=np.float64), 1.0))",
        MATERIALS,
    ),
)
