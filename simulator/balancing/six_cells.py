"""The six cells of the balancing thesis: SANYO UR18650W as simulated there, with a borrowed 4 Ah parameter set.

The set itself is not printed there. What is known fixes it: 4 Ah, 3.48 V when empty, 4.19 V when full, three RC pairs
measured at 5, 20 and 40 degC, volumetric heat capacity 2.04e6 J/m3K and 5 W/m2K of convection over 64 cm2. R0 is that
of the class of cell it was measured on; the pairs bring the sum to 14 mohm, which the warming at 5C and 6C asks for.
"""

from __future__ import annotations

from simulator.accumulator import AccumulatorParameters
from simulator.cell_data import CellModel, Table
from simulator.thermal import ThermalParameters

RATED_AH = 1.5  # rated capacity; a charge at 1C runs at this many amperes
START_SOC = (0.21, 0.209, 0.202, 0.204, 0.20, 0.207)
AMBIENT_DEGC = 23.0
START_DEGC = 20.0

_FLAT = (0.0, 1.0)
_CONVECTION_W_PER_K = 0.032  # 5 W/m2K over 3.14 x 26 mm x (13 mm + 65 mm)
_HEAT_CAPACITY_J_PER_K = 43.0  # 2.04e6 J/m3K x 18 x 18 x 65 mm

UR18650W_AS_SIMULATED = CellModel(
    name="SANYO UR18650W with the thesis's 4 Ah parameters",
    capacity_ah=4.0,
    ocv_v=Table(
        (-0.1, 0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0, 1.1),
        (3.30, 3.48, 3.56, 3.63, 3.715, 3.92, 4.076, 4.19, 4.30),
    ),
    entropy_v_per_k=Table(_FLAT, (0.0, 0.0)),
    ohmic_ohm=Table((0.0, 0.1, 0.5, 1.0), (0.0090, 0.0085, 0.0082, 0.0082)),
    charge_transfer_ohm=Table(_FLAT, (0.0, 0.0)),
    rc_ohm=(
        Table((0.0, 0.2, 1.0), (0.0034, 0.0020, 0.0017)),
        Table((0.0, 0.2, 1.0), (0.0040, 0.0023, 0.0019)),
        Table((0.0, 0.2, 1.0), (0.0052, 0.0028, 0.0023)),
    ),
    rc_f=(2e3, 2e4, 2e5),
    ohmic_j_per_mol=11e3,
    rc_j_per_mol=25e3,
    heat_capacity_j_per_k=_HEAT_CAPACITY_J_PER_K,
)


def six_cells(
    *, ambient_degc: float = AMBIENT_DEGC, start_soc: tuple[float, ...] = START_SOC, bleed_ohm: float = 40.0
) -> AccumulatorParameters:
    """Return six equal cells in series with resistors that heat their own cells, as the thesis connects them."""
    return AccumulatorParameters(
        n_cells=len(start_soc),
        cells_per_pack=len(start_soc),
        start_soc=start_soc,
        start_soc_spread=0.0,
        capacity_spread=0.0,
        resistance_spread=0.0,
        self_discharge_spread=0.0,
        joint_resistance_ohm=0.0,
        path_resistance_ohm=0.0,
        ambient_degc=ambient_degc,
        start_degc=START_DEGC,
        cell=UR18650W_AS_SIMULATED,
        bleed_ohm=bleed_ohm,
        bleed_heat_in_cell=1.0,
        slow_period_s=10.0,
        thermal=ThermalParameters(
            along_row_w_per_k=_CONVECTION_W_PER_K,
            across_rows_w_per_k=_CONVECTION_W_PER_K,
            natural_w_per_k=_CONVECTION_W_PER_K,
            board_to_cell_w_per_k=0.0,
            n_ducts=1,
        ),
    )
