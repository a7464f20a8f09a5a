"""Parameters of the three-lobe fiber scattering model, shared by the fit, the presets and the renderer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from weft.files.errors import InputError

LONGITUDINAL_KINDS = ("gaussian", "vmf", "symmetric")
AZIMUTHAL_KINDS = ("wrapped_normal", "von_mises")
GRAZING = (
    "longitudinal_width_r_grazing",
    "longitudinal_width_tt_grazing",
    "longitudinal_width_trt_grazing",
    "azimuthal_width_tt_grazing",
    "azimuthal_width_trt_grazing",
    "fresnel_tt_grazing",
)
"""What a width and T become for light along the fiber; each without its suffix is the value for light at a
right angle. Between them they go linearly with 1 - cos(theta_o)."""
Table = tuple[tuple[float, ...], ...]
"""Rows of densities around the fiber, see azimuthal_table.py."""
ROWS, KNOTS = (1, 4), (9, 129)
"""Fewest and most rows of a table, and numbers of a row."""
TAILS = tuple(
    f"tail_{name}"
    for lobe in ("r", "tt", "trt")
    for name in (f"weight_{lobe}", f"weight_{lobe}_grazing", f"ratio_{lobe}")
)
"""Of each lobe: its tail's part for light at a right angle and along the fiber, and its width over beta."""
TAIL_RATIO = (0.25, 4.0)
TABLES = ("azimuthal_table_r", "azimuthal_table_tt", "azimuthal_table_trt")


@dataclass(frozen=True)
class FiberScatteringParameters:
    """Three-lobe fiber scattering (R, TT, TRT), extending Khungurn et al. 2015 (thesis section 6.2).

    Angles in radians. Colors are linear RGB in [0, 1]. Energies, with F the Schlick Fresnel term from
    `fresnel_r` and T = `fresnel_tt`: a_R = C_R F, a_TT = C_TT (1-F) T, a_TRT = C_TRT (1-F) (1-T).
    """

    longitudinal_width_r: float
    longitudinal_width_tt: float
    longitudinal_width_trt: float
    azimuthal_width_tt: float
    fresnel_r: tuple[float, float, float]
    fresnel_tt: float
    color_r: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color_tt: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color_trt: tuple[float, float, float] = (1.0, 1.0, 1.0)
    azimuthal_width_trt: float | None = None
    """None: the TRT lobe is uniform around the fiber, as in the thesis."""
    longitudinal: str = "gaussian"
    """Kind of the longitudinal lobes: gaussian | vmf | symmetric (reciprocal)."""
    azimuthal: str = "wrapped_normal"
    """Kind of the azimuthal lobes: wrapped_normal | von_mises."""
    longitudinal_width_r_grazing: float | None = None
    """None, as of all that follow: the same for all inclinations of the light."""
    longitudinal_width_tt_grazing: float | None = None
    longitudinal_width_trt_grazing: float | None = None
    azimuthal_width_tt_grazing: float | None = None
    azimuthal_width_trt_grazing: float | None = None
    fresnel_tt_grazing: float | None = None
    azimuthal_table_r: Table | None = None
    """N_R in place of the uniform one: rows of densities at equal steps from the lobe's center to the
    opposite side, normalized by the model; see azimuthal_table.py. All tables of a fiber have one shape."""
    azimuthal_table_tt: Table | None = None
    """N_TT; `azimuthal_width_tt` then is only the width of the simple lobe that comes nearest."""
    azimuthal_table_trt: Table | None = None
    tail_weight_r: float | None = None
    """Part of R that lies in a heavy tail along the fiber, see tail.py, for light at a right angle. None: R
    has no tail."""
    tail_weight_r_grazing: float | None = None
    """For light along the fiber; None: the same."""
    tail_ratio_r: float | None = None
    """Width of the tail over that of the lobe, `longitudinal_width_r`, with which it grows."""
    tail_weight_tt: float | None = None
    tail_weight_tt_grazing: float | None = None
    tail_ratio_tt: float | None = None
    tail_weight_trt: float | None = None
    tail_weight_trt_grazing: float | None = None
    tail_ratio_trt: float | None = None

    @property
    def tables(self) -> tuple[Table | None, Table | None, Table | None]:
        """Tables around the fiber of the lobes R, TT, TRT."""
        return self.azimuthal_table_r, self.azimuthal_table_tt, self.azimuthal_table_trt

    @property
    def has_tails(self) -> bool:
        return any(getattr(self, name) is not None for name in TAILS)

    @property
    def varies_with_angle(self) -> bool:
        """Whether a width or T depends on the inclination of the light."""
        return any(getattr(self, name) is not None for name in GRAZING)

    def at_grazing(self, name: str) -> float | None:
        """What `name`, a width or "fresnel_tt", is for light along the fiber."""
        grazing = getattr(self, f"{name}_grazing")
        return getattr(self, name) if grazing is None else grazing

    def __post_init__(self) -> None:
        _check_kind("longitudinal", self.longitudinal, LONGITUDINAL_KINDS)
        _check_kind("azimuthal", self.azimuthal, AZIMUTHAL_KINDS)
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, str) or field.name in TABLES:
                continue
            if field.name.startswith("longitudinal_width"):
                _check_angle(field.name, value, 0.5, 60.0)
            elif field.name.startswith("azimuthal_width"):
                _check_angle(field.name, value, 2.0, 300.0)
            elif field.name.startswith("tail_ratio"):
                _check_ratio(field.name, value)
            else:
                _check_unit_interval(field.name, value)
        self._check_grazing()
        self._check_tables()
        for lobe in ("r", "tt", "trt"):
            self._check_tail(lobe)

    def _check_grazing(self) -> None:
        if self.longitudinal == "symmetric" and self.varies_with_angle:
            given = next(name for name in GRAZING if getattr(self, name) is not None)
            raise InputError(
                f"scattering: {given} cannot go with the longitudinal kind 'symmetric': a lobe that depends "
                "on one of the two angles alone is not reciprocal",
                hint="Take the kind 'gaussian' or 'vmf', or leave the grazing values out.",
            )
        for lobe in ("r", "tt", "trt"):
            _check_growth(f"longitudinal_width_{lobe}_grazing", self)
        if self.azimuthal_width_trt is None and self.azimuthal_width_trt_grazing is not None:
            raise InputError("scattering: azimuthal_width_trt_grazing needs azimuthal_width_trt, not uniform")

    def _check_tail(self, lobe: str) -> None:
        weight, ratio = f"tail_weight_{lobe}", f"tail_ratio_{lobe}"
        given = [name for name in (weight, ratio, f"{weight}_grazing") if getattr(self, name) is not None]
        if not given:
            return
        for needed in (weight, ratio):
            if needed not in given:
                raise InputError(f"scattering: {given[0]} needs {needed} beside it")
        if self.longitudinal == "symmetric":
            raise InputError(
                f"scattering: {weight} cannot go with the longitudinal kind 'symmetric'",
                hint="Take the kind 'gaussian' or 'vmf', or leave the tails out.",
            )
        width = f"longitudinal_width_{lobe}"
        narrowest = getattr(self, ratio) * min(getattr(self, width), self.at_grazing(width) or 0.0)
        if math.degrees(narrowest) < 0.5 - 1e-9:
            raise InputError(
                f"scattering: {ratio} makes a tail of {math.degrees(narrowest):.3g} deg; its width, the "
                f"ratio times {width}, must be at least 0.5 deg"
            )

    def _check_tables(self) -> None:
        given = {name: getattr(self, name) for name in TABLES if getattr(self, name) is not None}
        check_tables(given)
        for name, table in given.items():
            if self.longitudinal == "symmetric" and len(table) > 1:
                raise InputError(
                    f"scattering: {name} has {len(table)} rows, which cannot go with the longitudinal kind "
                    "'symmetric': a lobe that depends on one of the two angles alone is not reciprocal",
                    hint="Give it one row, or take the kind 'gaussian' or 'vmf'.",
                )


def _check_kind(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(f"scattering: {name} kind '{value}' is unknown", hint=f"Known: {', '.join(known)}.")


def check_tables(tables: Mapping[str, Table]) -> None:
    """Raises `InputError` for what is no table of densities, or where the shapes differ."""
    for name, table in tables.items():
        _check_table(name, table)
    shapes = {name: (len(table), len(table[0])) for name, table in tables.items()}
    if len(set(shapes.values())) > 1:
        said = ", ".join(f"{name} {rows} x {knots}" for name, (rows, knots) in shapes.items())
        raise InputError(f"scattering: the tables of a fiber must have one shape, found {said}")


def _check_table(name: str, table: Table) -> None:
    lengths = {len(row) for row in table}
    if not ROWS[0] <= len(table) <= ROWS[1]:
        raise InputError(f"scattering: {name} has {len(table)} rows; it must have {ROWS[0]} to {ROWS[1]}")
    if len(lengths) > 1 or not KNOTS[0] <= min(lengths) <= KNOTS[1]:
        raise InputError(
            f"scattering: {name} has rows of {', '.join(map(str, sorted(lengths)))} numbers; "
            f"all must have the same number, {KNOTS[0]} to {KNOTS[1]}"
        )
    if not all(math.isfinite(sum(row)) and min(row) >= 0 and max(row) > 0 for row in table):
        raise InputError(
            f"scattering: {name} must hold finite densities of at least 0, and one above 0 in each row"
        )


def _check_angle(name: str, radians: float, least_deg: float, most_deg: float) -> None:
    degrees = math.degrees(radians)
    # the range that the tests of normalization and sampling cover; 1e-9 forgives the conversion to radians
    if not least_deg - 1e-9 <= degrees <= most_deg + 1e-9:
        raise InputError(
            f"scattering: {name} is {degrees:g} deg; it must lie in [{least_deg:g}, {most_deg:g}] deg"
        )


def _check_growth(name: str, parameters: FiberScatteringParameters) -> None:
    """Light along the fiber finds wider lobes or a little narrower ones: so far the shader's constants go."""
    grazing, normal = getattr(parameters, name), getattr(parameters, name.removesuffix("_grazing"))
    if grazing is not None and not 0.5 * normal * (1 - 1e-9) <= grazing <= math.radians(45.0) * (1 + 1e-9):
        raise InputError(
            f"scattering: {name} is {math.degrees(grazing):g} deg; it must lie between half the width at "
            f"normal incidence ({0.5 * math.degrees(normal):g} deg) and 45 deg"
        )


def _check_ratio(name: str, value: float) -> None:
    if not TAIL_RATIO[0] <= value <= TAIL_RATIO[1]:
        raise InputError(
            f"scattering: {name} is {value:g}; a tail's width over the lobe's must lie in "
            f"[{TAIL_RATIO[0]:g}, {TAIL_RATIO[1]:g}]"
        )


def _check_unit_interval(name: str, value: float | tuple[float, ...]) -> None:
    for number in value if isinstance(value, tuple) else (value,):
        if not 0.0 <= number <= 1.0:
            raise InputError(f"scattering: {name} is {number:g}; an energy fraction must lie in [0, 1]")
