"""Tables around the fiber as shaders/phase/fiber_azimuthal_table.glsl reads them.

One medium's rows of vec4, lanes R, TT, TRT: for each light and knot the density, then, to sample the hat
functions that make it up (Walker 1977), the chance to keep the knot that was drawn and the knot to take
otherwise. Knots go from the center of TT to the opposite side for all lobes: one angle finds all densities.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.azimuthal_table import knot_masses, table_densities
from weft.fiber_model.scattering.parameters import FiberScatteringParameters

from .lights import alias_table

Array = NDArray[np.float64]


def table_shape(parameters: FiberScatteringParameters) -> tuple[int, int]:
    """Cells and rows of the tables, which share them; zeros where there is none."""
    given = [table for table in parameters.tables if table is not None]
    return (len(given[0][0]) - 1, len(given[0])) if given else (0, 0)


def azimuthal_row_count(parameters: FiberScatteringParameters) -> int:
    """Rows of fiber_table[] that the medium takes."""
    cells, lights = table_shape(parameters)
    return 3 * (cells + 1) * lights


def azimuthal_rows(parameters: FiberScatteringParameters) -> Array:
    """Shape [azimuthal_row_count, 4]; a lobe without a table is uniform here."""
    cells, lights = table_shape(parameters)
    rows = np.zeros((lights, cells + 1, 3, 4))
    for lobe, table in enumerate(parameters.tables):
        uniform = np.full((lights, cells + 1), 1 / (2 * np.pi))
        densities = uniform if table is None else table_densities(table)
        from_tt = densities if lobe == 1 else densities[:, ::-1]
        for light, density in enumerate(from_tt):
            kept, alias = alias_table(density * knot_masses(cells + 1))
            rows[light, :, :, lobe] = np.stack([density, kept, alias], axis=-1)
    return rows.reshape(-1, 4)
