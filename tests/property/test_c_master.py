"""The master's modules in C against the virtual master's, on the same random measurements: every output the same."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.config_image import check, default_image
from firmware_protocol.memory_map import CONFIG, N_CELLS
from simulator.charging import Balancer, Charging
from simulator.fans import Fans
from simulator.memory import Config, MasterMemory
from simulator.protection import CHARGE_TOLERANCE, Latch, Reading
from simulator.relays import Relays
from simulator.soc_counter import SocCounter
from tests.c_master import (
    DUE_S,
    CBalancer,
    CCharging,
    CFans,
    CProtection,
    CRelays,
    CSocCounter,
    PythonProtection,
    image_of,
)
from tests.campaign import examples

DEFAULT = Config.from_image(default_image())
STEPS_MS = st.sampled_from((1, 10, 20, 20, 20, 100, 200, 290, 300, 310, 500, 1000))
AROUND = st.integers(-2, 2)


def in_range(name):
    return st.integers(CONFIG[name].minimum, CONFIG[name].maximum)


CONFIGS = st.builds(
    lambda values: replace(DEFAULT, **values),
    st.fixed_dictionaries(
        {
            name: in_range(name)
            for name in (
                *("v_cell_min", "v_cell_max", "t_cell_min", "t_cell_max", "i_disc_min", "i_disc_max", "i_chrg_min"),
                *("ts", "fc_avg", "i_chrg_max", "fan_ramp_start", "fan_ramp_stop", "fan_ramp_min", "fan_ramp_max"),
            )
        }
    ),
).filter(lambda config: not [error for error in check(image_of(config)) if error.field != "v_cell_chrg"])


def or_none(strategy):
    return st.none() | st.none() | strategy


@st.composite
def readings(draw, config):
    """Values at, just beyond and far from their limits, and what is missing."""

    def near(low, high, first, last):
        picked = draw(st.sampled_from((low, low, high, high, (low + high) // 2)))
        value = draw(st.just(picked + draw(AROUND)) | st.integers(first, last))
        return min(max(value, first), last)

    tolerance = draw(st.sampled_from((-CHARGE_TOLERANCE, 0, CHARGE_TOLERANCE)))
    is_charging = draw(st.booleans())
    low, high = (config.i_chrg_min, config.i_chrg_max) if is_charging else (config.i_disc_min, config.i_disc_max)
    current = near(low + tolerance, high + tolerance, -(1 << 30), 1 << 30)
    cells = st.integers(0, 95)
    return Reading(
        v_min=near(config.v_cell_min, config.v_cell_max, 0, 0xFFFF),
        v_min_id=draw(cells),
        v_max=near(config.v_cell_min, config.v_cell_max, 0, 0xFFFF),
        v_max_id=draw(cells),
        t_min=near(config.t_cell_min, config.t_cell_max, -128, 127),
        t_min_id=draw(cells),
        t_max=near(config.t_cell_min, config.t_cell_max, -128, 127),
        t_max_id=draw(cells),
        i_fc=-current if is_charging else current,
        is_charging=is_charging,
        lost_cell=draw(or_none(cells)),
        lost_temperature=draw(or_none(cells)),
        lost_slave=draw(or_none(st.integers(0, 7))),
        lost_current=draw(st.booleans()),
    )


@st.composite
def measurements(draw):
    """A configuration, and readings of which some last for several passes: (reading, passes, ms between, clear?)."""
    config = draw(CONFIGS)
    calm = Reading(
        config.v_cell_max - 1, 3, config.v_cell_max - 1, 4, config.t_cell_max, 5, config.t_cell_max, 6,
        0, False, None, None, None, False,
    )  # fmt: skip
    step = st.tuples(
        st.just(calm) | readings(config), st.integers(1, 6), STEPS_MS, st.integers(0, 9).map(lambda n: not n)
    )
    return config, draw(st.lists(step, min_size=1, max_size=20))


@given(case=measurements(), start_ms=st.sampled_from((0, 0xFFFFFF00, 0xFFFFFFFF)))
@settings(max_examples=examples(150))
def test_both_protections_trip_at_the_same_time_for_the_same_reason(case, start_ms):
    config, steps = case
    latches = Latch(), Latch()
    both = PythonProtection(latches[0]), CProtection(latches[1])
    now_ms = start_ms
    for reading, passes, step_ms, is_cleared in steps:
        for _ in range(passes):
            now_ms += step_ms
            events, ours = (side.judge(config, reading, now_ms / 1000) for side in both)
            assert ours == events
            assert both[0].is_ok == both[1].is_ok
        if is_cleared:
            assert both[0].clear() == both[1].clear()
            assert both[0].is_ok == both[1].is_ok


@given(
    config=CONFIGS,
    steps=st.lists(
        st.tuples(
            STEPS_MS | st.just(30_000),
            st.none() | st.just(-1) | st.builds(lambda duty, s: duty | s << 8, st.integers(0, 255), st.integers(0, 60)),
            st.integers(-128, 127),
        ),
        max_size=40,
    ),
)
@settings(max_examples=examples(100))
def test_both_fans_turn_alike(config, steps):
    both = Fans(), CFans()
    now_ms = 0
    for looks, (step_ms, argument, t_max) in enumerate(steps):
        now_ms += step_ms
        now_s = now_ms / 1000 + looks * DUE_S
        if argument is not None:
            for fans in both:
                fans.command(argument, now_s)
        assert both[0].duty(config, t_max, now_s) == both[1].duty(config, t_max, now_s)


@given(
    c_avg=st.sampled_from((10, 2500, 32_767)) | in_range("c_avg"),
    steps=st.lists(
        st.one_of(
            st.tuples(st.just("count"), st.integers(-540_000, 540_000) | st.integers(-400, 400), in_range("ts")),
            st.tuples(st.just("rest"), st.integers(0, 0xFFFF) | st.integers(26_000, 42_500), st.integers(-202, 202)),
            st.tuples(st.just("set"), st.integers(0, 10_000), st.just(0)),
            st.tuples(st.just("journal"), st.integers(0, 330_000_000), st.just(0)),
        ),
        max_size=40,
    ),
)
@settings(max_examples=examples(150))
def test_both_counters_count_the_same(c_avg, steps):
    both = SocCounter(), CSocCounter()
    config = replace(DEFAULT, c_avg=c_avg)
    for what, first, second in steps:
        for counter in both:
            if what == "count":
                counter.count(replace(config, ts=second), first)
            elif what == "rest":
                counter.start_from_rest(config, first, second)
            elif what == "set":
                counter.set_soc(config, first)
            else:
                counter.start_from_journal(first)
        assert both[1].dod_uah == both[0].dod_uah
        assert both[1].is_started == both[0].is_started
        assert both[1].soc_counts(config) == both[0].soc_counts(config)


def test_both_counters_start_alike_from_every_voltage():
    both = SocCounter(), CSocCounter()
    for v in range(25_000, 43_000, 7):
        assert both[1].start_from_rest(DEFAULT, v, 0) == both[0].start_from_rest(DEFAULT, v, 0)
        assert both[1].dod_uah == both[0].dod_uah


RELAY_STEPS = st.lists(
    st.tuples(
        STEPS_MS | st.just(3000), st.integers(0, 9), st.integers(0, 9), st.integers(0, 9), st.integers(900, 1000),
        st.integers(0, 19),
    ),
    max_size=60,
)  # fmt: skip


@given(steps=RELAY_STEPS)
@settings(max_examples=examples(100))
def test_both_sets_of_relays_switch_alike(steps):
    both = Relays(), CRelays()
    now_ms = 0
    for looks, (step_ms, ok, drive, charging, permille, retry) in enumerate(steps):
        now_ms += step_ms
        states = set()
        for relays in both:
            if not retry:
                relays.retry()
            states.add(
                relays.step(
                    now_ms / 1000 + looks * DUE_S,
                    is_ok=ok > 0,
                    drive_requested=drive > 1,
                    charging=charging > 7,
                    link_share=permille / 1000 + 1e-9,
                )
            )
        assert len(states) == 1
        assert both[0].has_precharge_failed == both[1].has_precharge_failed


CHARGE_CONFIGS = st.builds(
    lambda chrg, above, amps, threshold: replace(
        DEFAULT, v_cell_chrg=chrg, v_cell_max=chrg + above, i_chrg_max=amps, balance_threshold=threshold
    ),
    st.integers(40_000, 43_000),
    st.integers(0, 60),
    st.integers(0, 3000),
    st.integers(10, 5000),
)
CHARGE_STEPS = st.lists(
    st.fixed_dictionaries(
        {
            "do": st.sampled_from(("", "", "", "", "start", "start", "stop", "fault")),
            "passes": st.sampled_from((1, 2, 15, 40)),
            "pass_ms": st.sampled_from((20, 100, 1000, 1000)),
            "below": st.integers(-40, 60) | st.integers(-2000, 3000),  # the mean cell under the end of charge
            "highest": st.integers(0, 60),
            "spread": st.integers(0, 40) | st.integers(0, 6000),
            "missing": st.booleans(),
            "rise": st.integers(-3, 3),  # of all cells in a pass
            "i_out": st.integers(0, 12) | st.integers(0, 180),
            "flags": st.sampled_from((0, 0, 0, 0, 0, 0, 16, 1, 2, 4, 8, 255)),
            "alive": st.sampled_from((True, True, True, True, False)),
        }
    ),
    min_size=1,
    max_size=12,
)


@given(config=CHARGE_CONFIGS, steps=CHARGE_STEPS, seed=st.integers(0, 1 << 32))
@settings(max_examples=examples(60))
def test_both_chargings_ask_for_the_same_current_at_the_same_time(config, steps, seed):
    rng = np.random.default_rng(seed)
    memories = MasterMemory(), MasterMemory()
    both = Charging(memories[0], Balancer()), CCharging(memories[1], CBalancer())
    now_ms = looks = 0
    for step in [{**steps[0], "do": "start", "flags": 0, "alive": True}, *steps]:
        shape = rng.integers(0, step["spread"] + 1, N_CELLS)
        shape[rng.integers(N_CELLS)] = step["spread"] + step["highest"]
        for k in range(step["passes"]):
            now_ms += step["pass_ms"]
            looks += 1
            now_s = now_ms / 1000 + looks * DUE_S
            v = config.v_cell_chrg - step["below"] + k * step["rise"] + shape - step["spread"]
            if step["missing"]:
                v[7] = 0
            for memory in memories:
                memory.v[:] = v
                memory.set_charger("i_out", step["i_out"])
                memory.set_charger("flags", step["flags"])
            events, ours = (told(charging, config, step, now_s, k == 0, int(v.max())) for charging in both)
            assert ours == events
            assert both[1].state == both[0].state
            assert both[1].is_active == both[0].is_active
            for name in ("v_set", "i_set", "control", "state"):
                assert memories[1].charger(name) == memories[0].charger(name), name
            assert both[1].balancer.cells.tolist() == both[0].balancer.cells.tolist()


def told(charging, config, step, now_s, is_first, v_max):
    """Carry out a step's command before its first pass; return the events of the pass."""
    events = []
    if is_first and step["do"] == "start":
        events += charging.start(now_s)
    elif is_first and step["do"]:
        events += charging.stop(now_s, fault=step["do"] == "fault")
    return events + charging.step(config, now_s, charger_alive=step["alive"], v_max=v_max)


@given(
    config=CHARGE_CONFIGS,
    milliohm=st.integers(1, 45),
    below=st.integers(10, 900),
    spread=st.integers(0, 60),
    pulled_at=st.none() | st.integers(100, 3000),
)
@settings(max_examples=examples(60))
def test_both_chargings_bring_simple_cells_to_the_same_end(config, milliohm, below, spread, pulled_at):
    """Cells of 3 mohm with one of another resistance; the charger answers a command a second late."""
    memories = MasterMemory(), MasterMemory()
    both = Charging(memories[0], Balancer()), CCharging(memories[1], CBalancer())
    ocv = np.full(N_CELLS, config.v_cell_chrg - below, dtype=np.float64) + np.linspace(-spread, 0, N_CELLS)
    resistance = np.full(N_CELLS, 30.0)
    resistance[30] = 10.0 * milliohm
    asked, current_a = [0] * 5, 0.0
    for charging in both:
        charging.start(0.0)
    for k in range(4000):
        now_s = 0.2 * (k + 1) + k * DUE_S
        current_a += 0.5 * (asked[-5] / 10 - current_a)
        ocv += current_a * 0.2 * 0.25 - 0.1 * both[0].balancer.cells
        v = np.rint(ocv + resistance * current_a)
        for memory in memories:
            memory.v[:] = v
            memory.set_charger("i_out", round(current_a * 10))
        events, ours = (
            charging.step(config, now_s, charger_alive=k != pulled_at, v_max=int(v.max())) for charging in both
        )
        assert ours == events
        for name in ("v_set", "i_set", "control", "state"):
            assert memories[1].charger(name) == memories[0].charger(name), name
        assert both[1].balancer.cells.tolist() == both[0].balancer.cells.tolist()
        asked.append(memories[0].charger("i_set") * (1 - memories[0].charger("control")))
        if not both[0].is_active:
            break
