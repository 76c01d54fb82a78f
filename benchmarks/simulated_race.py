"""The estimators in the simulated accumulator, whose physics and numbers they do not know.

Plays endurance races of the virtual master (its own spread, sensor errors and joints), reads its telemetry frames, and
reports: the worst cell's SOC error, how much too high the driver's SOC ever was, how often the truth lay within
3 sigma, and which joints were named: none may be in a clean race, the loosened one within a lap. What is learned of the
cells during a race feeds the filter, as in the service.

    python -m benchmarks.simulated_race [--races 10] [--seconds 1700] [--filter fused]
    python -m benchmarks.simulated_race --bolts 4 --seconds 330
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import FILTERS, make_estimator
from app.estimation.prediction.constant_current import Limits
from app.estimation.prediction.driver_soc import DriverSoc
from app.live.prediction import Predictor
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import FIELDS, N_CELLS
from firmware_protocol.messages import Data, MessageType
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer

FloatArray = NDArray[np.float64]
BOLT_AT_S = 250.0
BOLT_MOHM = 0.3
STEP_S = 0.05  # of the physics


@dataclass(frozen=True)
class Sample:
    """One telemetry frame and the truth at its instant."""

    uptime_s: float
    current_a: float
    voltages_v: FloatArray
    temperatures_degc: FloatArray
    true_soc: FloatArray


def drive(seed: int, seconds: float, bolt: int | None = None) -> Iterator[Sample]:
    """Yield the samples of a race; `bolt` names the cell whose joint grows by BOLT_MOHM at BOLT_AT_S."""
    player = ScenarioPlayer(find_scenario("clean-endurance"), seed=seed, step_s=STEP_S)
    simulation, decoder = player.simulation, FrameDecoder()
    arrived: list[Sample] = []
    fields = {name: FIELDS[name] for name in ("i_fs", "v", "t")}

    def take(data: bytes) -> None:
        for frame in decoder.feed(data):
            if not isinstance(frame, Frame) or frame.type != MessageType.DATA:
                continue
            raw = {
                name: field.unpack(window.data, -window.offset)
                for window in Data.from_body(frame.body).windows
                for name, field in fields.items()
                if window.offset <= field.offset and field.end <= window.offset + len(window.data)
            }
            if len(raw) == len(fields):
                arrived.append(
                    Sample(
                        frame.uptime_ms / 1000,
                        raw["i_fs"][0] * fields["i_fs"].scale,
                        np.array(raw["v"]) * fields["v"].scale,
                        np.array(raw["t"], dtype=np.float64),
                        simulation.accumulator.soc.copy(),
                    )
                )

    simulation.serial_out = take
    simulation.run_until(0.2)
    simulation.receive(b"x")
    while simulation.now_s < seconds and not player.is_over:
        player.run(1.0)
        if bolt is not None and simulation.now_s > BOLT_AT_S:
            player.faults.inject("loose-joint", bolt, BOLT_MOHM)
            bolt = None
        yield from arrived
        arrived.clear()


@dataclass(frozen=True)
class Result:
    """Results of a race; SOC errors in percent."""

    seed: int
    worst_rmse: float
    worst_error: float
    driver_too_high: float
    inside_3_sigma: float
    named_after_s: float | None  # the loosened joint
    named_wrongly: tuple[int, ...]


def race(seed: int, seconds: float, filter_name: str, bolt: int | None = None) -> Result:
    """Estimate a race and judge its joints."""
    cell, driver, limits = load_cell("samsung-25r-10p"), DriverSoc(N_CELLS), Limits()
    estimator, predictor = make_estimator(filter_name, cell, N_CELLS), Predictor(cell, (12,) * 8)
    before_s: float | None = None
    squares, worst, inside, n, too_high = np.zeros(N_CELLS), 0.0, 0.0, 0, -100.0
    named_after_s, wrong = None, set[int]()
    for sample in drive(seed, seconds, bolt):
        if before_s is None:
            estimator.start(sample.voltages_v, sample.temperatures_degc, sample.current_a)
            before_s = sample.uptime_s
        dt_s, before_s = sample.uptime_s - before_s, sample.uptime_s
        estimate = estimator.step(dt_s, sample.current_a, sample.voltages_v, sample.temperatures_degc)
        power_w = float(sample.voltages_v.sum()) * sample.current_a
        predictor.step(dt_s, sample.current_a, sample.voltages_v, power_w, estimate, sample.temperatures_degc)
        predictor.assess(estimator, estimate, sample.temperatures_degc, sample.current_a, limits)
        predictor.apply_learned(estimator)
        error = estimate.soc - sample.true_soc
        squares += error**2
        worst = max(worst, float(np.abs(error).max()))
        inside += float((np.abs(error) < 3.0 * estimate.soc_sigma).mean())
        n += 1
        percent = driver.step(estimate.soc).percent
        if percent is not None:
            too_high = max(too_high, percent - 100.0 * float(sample.true_soc.min()))
        if predictor.assessment.loose is not None:
            loose = set(np.flatnonzero(predictor.assessment.loose).tolist())
            wrong |= loose - {bolt}
            if bolt in loose and named_after_s is None:
                named_after_s = sample.uptime_s - BOLT_AT_S
    rmse = float(np.sqrt(squares / n).max())
    return Result(seed, 100 * rmse, 100 * worst, too_high, inside / n, named_after_s, tuple(sorted(wrong)))


def main() -> None:
    """Print a line a race."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--races", type=int, default=10)
    parser.add_argument("--bolts", type=int, default=0, help="races with a loose bolt instead of clean ones")
    parser.add_argument("--seconds", type=float, default=1700.0)
    parser.add_argument("--filter", choices=FILTERS, default="fused")
    args = parser.parse_args()
    cells = np.random.default_rng(7).permutation(N_CELLS)
    print(f"{'seed':>4} {'worst rmse %':>12} {'worst %':>8} {'driver high %':>13} {'in 3 sigma':>10}  joints")
    for i in range(args.bolts or args.races):
        bolt = int(cells[i]) if args.bolts else None
        r = race(11 + i, args.seconds, args.filter, bolt)
        joints = "no name" if not r.named_wrongly else f"wrongly named {r.named_wrongly}"
        if bolt is not None:
            after = "never" if r.named_after_s is None else f"after {r.named_after_s:.0f} s"
            joints = f"cell {bolt} named {after}; {joints} else"
        print(
            f"{r.seed:>4} {r.worst_rmse:>12.2f} {r.worst_error:>8.2f} {r.driver_too_high:>13.2f} "
            f"{r.inside_3_sigma:>10.3f}  {joints}",
            flush=True,
        )


if __name__ == "__main__":
    main()
