"""Every unit of the master's struct against the numbers that the BMS thesis prints, in figures 4.1.1 to 4.1.4 and B.12.

A table that `python -m benchmarks.sources_tables` prints.
"""

from __future__ import annotations

from firmware_protocol.memory_map import FIELDS

PRINTED = {
    "v_min": 40594, "v_avg": 40725, "v_max": 40794, "v_tot": 4887, "i_fs": -5, "dod": 24079, "soc": 9991,
    "t_min": -8, "t_avg": -2, "t_max": 7, "c_min": 2500,
    "conf.v_cell_min": 25000, "conf.v_cell_chrg": 41500, "conf.v_cell_max": 42000, "conf.t_cell_min": -15,
    "conf.t_cell_max": 45, "conf.i_offset": 20490, "conf.i_gain": 12120, "conf.i_disc_max": 20000,
    "conf.i_chrg_max": 1200, "conf.c_avg": 2500, "conf.r_fs_avg": 210, "conf.fan_ramp_start": 20,
    "conf.fan_ramp_stop": 50, "conf.fan_ramp_min": 32, "conf.fan_ramp_max": 224, "conf.balance_threshold": 250,
    "conf.v_alpha": 500, "conf.can_brp": 7, "conf.ts": 100,
}  # fmt: skip
CELLS = 12  # one slave was connected
CELL_AH, CELLS_A_MODULE = 2.5, 10
COUNT_A = 3.3 / 4096 * 3.0 * 100.0  # 12 bits of 3.3 V; the amplifier gives a third; 100 A a volt of the HAL400-S
SOC_COUNTS = 10_000


def value(name: str) -> float:
    """Return a printed count in our unit."""
    return PRINTED[name] * float(FIELDS[name].scale)


def soc_of(dod: int, counts_an_ah: float) -> int:
    """Return what integer division makes of the charge drawn, for so many counts an ampere hour."""
    return SOC_COUNTS - int(dod * SOC_COUNTS // (CELL_AH * CELLS_A_MODULE * counts_an_ah))


def units() -> list[str]:
    """Return the table: fields, what is printed, what that is by our map, what it is held against, and the verdict."""
    module_ah = CELL_AH * CELLS_A_MODULE
    rows = [
        (
            "`v_min`, `v_avg`, `v_max`", f"{value('v_min'):.4f}, {value('v_avg'):.4f}, {value('v_max'):.4f} V",
            "in this order, below the 4.2 V of a cell", "agrees",
        ),
        (
            "`v_tot`", f"{value('v_tot'):.2f} V", f"{CELLS} cells of `v_avg`: {CELLS * value('v_avg'):.2f} V",
            "agrees",
        ),
        (
            "`conf.v_cell_min`, `_chrg`, `_max`",
            " / ".join(f"{value('conf.v_cell_' + name):.2f}" for name in ("min", "chrg", "max")) + " V",
            "the cell's 2.5 and 4.2 V", "agrees",
        ),
        (
            "`conf.i_offset`", f"{value('conf.i_offset'):.1f} counts", "1.65 V of 3.3 V in 12 bits: 2048.0",
            "agrees; with `ts` 100 alone, as a tenth of the sum is taken",
        ),
        (
            "`conf.i_gain`", f"{1e3 * value('conf.i_gain'):.1f} mA a count",
            f"sensor and amplifier: {1e3 * COUNT_A:.1f} mA", "agrees; the printed equation is cut off at its end",
        ),
        (
            "`i_fs`", f"{1e3 * value('i_fs'):.0f} mA", "no load, the mean of 100 samples of 242 mA a count", "agrees",
        ),
        (
            "`conf.i_disc_max`, `i_chrg_max`", f"{value('conf.i_disc_max'):.0f}, {value('conf.i_chrg_max'):.0f} A",
            "sensor 400 A; charger of 6.6 kW at 403 V: 16 A", "agrees",
        ),
        (
            "`conf.c_avg`, `c_min`", f"{value('conf.c_avg'):.0f} Ah",
            f"{CELLS_A_MODULE} cells of {CELL_AH} Ah: {module_ah:.0f} Ah", "agrees",
        ),
        (
            "`dod`, `soc`", f"{1e3 * value('dod'):.3f} mAh drawn; {100 * value('soc'):.2f} %",
            f"`soc` of 24079 counts by integer division, of uAh: {soc_of(PRINTED['dod'], 1e6)}; of mA s it"
            f" would be {soc_of(PRINTED['dod'], 3.6e6)}", "agrees",
        ),
        (
            "`conf.r_fs_avg`", f"{1e3 * value('conf.r_fs_avg'):.1f} mohm", "ten cells of about 20 mohm side by side",
            "agrees",
        ),
        (
            "`t_min`, `t_avg`, `t_max`", f"{value('t_min'):.0f}, {value('t_avg'):.0f}, {value('t_max'):.0f} degC",
            "the thesis: read too cold through the transistors; limits -15 and 45", "agrees",
        ),
        (
            "`conf.fan_ramp_*`", f"20..50 degC: {100 * value('conf.fan_ramp_min'):.1f}.."
            f"{100 * value('conf.fan_ramp_max'):.1f} %", "8 bits of duty", "agrees",
        ),
        (
            "`conf.v_alpha`", f"{value('conf.v_alpha'):g}", "its code weighs by `1000 - v_alpha`", "agrees",
        ),
        (
            "`conf.balance_threshold`", f"{1e3 * value('conf.balance_threshold'):.0f} mV",
            "nothing is printed to hold it against", "as all voltages",
        ),
        (
            "`conf.can_brp`", f"{32e3 / (PRINTED['conf.can_brp'] + 1) / 8:.0f} kbit/s", "what the charger speaks",
            "agrees",
        ),
        (
            "`conf.ts`", f"{PRINTED['conf.ts']} samples of 1 kHz, 100 ms",
            f"B.12: length of the buffer, at most {FIELDS['conf.ts'].maximum}; B.11: a tenth of the sum of them less"
            " `i_offset` is tenths of a count for 100 alone", "agrees; ours takes the mean, for any length",
        ),
    ]  # fmt: skip
    lines = ["| field | printed count, by our unit | held against | verdict |", "| --- | --- | --- | --- |"]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows)]
