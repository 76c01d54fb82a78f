"""Formula Student events as loads: a point mass driven round a track at the limit of grip, power and driver.

The power trace is worked out once, when the event is made, from a seed; afterwards it is only looked up.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from simulator.cell_data import FloatArray
from simulator.loads import ElectricalView, LoadState, Phase, PowerLimits

GRAVITY_M_PER_S2 = 9.81
AIR_KG_PER_M3 = 1.2
SAMPLE_S = 0.05  # period of the trace
_TRACK_STEP_M = 1.0
_TRACK_M = 1000


@dataclass(frozen=True)
class Car:
    """An electric Formula Student car with its driver."""

    mass_kg: float = 305.0
    drag_area_m2: float = 1.45
    down_force_area_m2: float = 2.6
    rolling: float = 0.02
    cornering: float = 0.09  # drag of slipping tyres as a part of the side force
    grip: float = 1.45
    power_w: float = 62e3  # electrical, what the driver's pedal reaches
    regeneration_w: float = 15e3
    regeneration_part: float = 0.16  # share of the braking force, by rear axle and blending
    drive_efficiency: float = 0.82
    standing_w: float = 300.0
    limits: PowerLimits = field(default_factory=PowerLimits)


@dataclass(frozen=True)
class Driver:
    """The driver's style: how close to the limits, and how evenly."""

    grip_part: float = 0.775
    power_part: float = 0.85
    lap_spread: float = 0.012  # relative spread of grip and power from lap to lap
    lift_m: float = 7.0  # coasting before each braking point


@dataclass(frozen=True)
class Lap:
    """One lap driven: (m,) arrays over time."""

    power_w: FloatArray  # electrical, negative while regenerating
    speed_m_per_s: FloatArray

    @property
    def duration_s(self) -> float:
        """Time of the lap [s]."""
        return len(self.power_w) * SAMPLE_S


def autocross_track(rng: np.random.Generator) -> FloatArray:
    """Return (m,) curvatures [1/m], one per metre, of a closed course of 1 km within the rules' sizes.

    Straights of up to 80 m, slaloms, hairpins of 4.5 m and more, bends of up to 25 m radius.
    """
    pieces: list[FloatArray] = []
    total = 0
    while total < _TRACK_M:
        straight_m = int(rng.uniform(12.0, 75.0))
        kind = rng.choice(3, p=(0.5, 0.3, 0.2))
        if kind == 0:
            radius_m = rng.uniform(9.0, 25.0)
            bend = np.full(int(radius_m * rng.uniform(0.6, 2.2)), 1.0 / radius_m)
        elif kind == 1:
            cones = int(rng.integers(3, 6))
            bend = np.abs(np.sin(np.linspace(0.0, np.pi * cones, int(cones * rng.uniform(9.0, 14.0))))) / 14.0
        else:
            radius_m = rng.uniform(5.0, 8.0)
            bend = np.full(int(radius_m * np.pi), 1.0 / radius_m)
        pieces += [np.zeros(straight_m), bend]
        total += straight_m + len(bend)
    return np.concatenate(pieces)[:_TRACK_M]


def drive_lap(car: Car, driver: Driver, curvature_per_m: FloatArray, *, start_m_per_s: float | None = None) -> Lap:
    """Drive along the course as fast as the limits allow.

    Speed in bends from grip, then a forward pass limited by power and traction and a backward pass limited by brakes;
    what the motor and the inverter need follows from force times speed.

    Args:
        car: what it can do.
        driver: how much of that is used.
        curvature_per_m: (m,) course, one entry a metre.
        start_m_per_s: speed at the first metre, or None for a flying lap.
    """
    grip = car.grip * driver.grip_part
    lift = 0.5 * AIR_KG_PER_M3 * car.down_force_area_m2 / car.mass_kg
    corner = grip * GRAVITY_M_PER_S2 / np.maximum(curvature_per_m - grip * lift, 1e-4)
    limit = np.minimum(np.sqrt(corner), 33.0)
    power_w = car.power_w * driver.power_part * car.drive_efficiency
    speed = limit if start_m_per_s is not None else np.concatenate((limit, limit))
    speed = _forward(car, speed, power_w, grip, start_m_per_s)
    speed = _backward(speed, grip)
    if start_m_per_s is None:
        speed = speed[len(limit) // 2 : len(limit) // 2 + len(limit)]
        curvature_per_m = np.roll(curvature_per_m, -(len(limit) // 2))
    return _trace(car, driver, speed, curvature_per_m, power_w)


def _forward(car: Car, limit: FloatArray, power_w: float, grip: float, start_m_per_s: float | None) -> FloatArray:
    speed = limit.copy()
    if start_m_per_s is not None:
        speed[0] = start_m_per_s
    now = float(speed[0])
    drag = 0.5 * AIR_KG_PER_M3 * car.drag_area_m2
    rolling = car.rolling * car.mass_kg * GRAVITY_M_PER_S2
    traction = 0.75 * grip * car.mass_kg * GRAVITY_M_PER_S2
    for i, allowed in enumerate(limit[1:].tolist(), start=1):
        force = min(power_w / max(now, 1.0), traction) - drag * now * now - rolling
        now = min(float(np.sqrt(max(now * now + 2.0 * force / car.mass_kg * _TRACK_STEP_M, 0.25))), allowed)
        speed[i] = now
    return speed


def _backward(limit: FloatArray, grip: float) -> FloatArray:
    speed = limit.copy()
    now = float(speed[-1])
    braking = grip * GRAVITY_M_PER_S2 * 0.9
    for i in range(len(limit) - 2, -1, -1):
        now = min(float(np.sqrt(now * now + 2.0 * braking * _TRACK_STEP_M)), float(limit[i]))
        speed[i] = now
    return speed


def _trace(car: Car, driver: Driver, speed: FloatArray, curvature_per_m: FloatArray, power_w: float) -> Lap:
    """Turn speed over distance into electrical power over time."""
    following = np.append(speed[1:], speed[-1])
    mean = np.maximum(0.5 * (speed + following), 0.5)
    force = car.mass_kg * (following**2 - speed**2) / (2.0 * _TRACK_STEP_M)
    force += 0.5 * AIR_KG_PER_M3 * car.drag_area_m2 * mean**2 + car.rolling * car.mass_kg * GRAVITY_M_PER_S2
    force += car.cornering * car.mass_kg * mean**2 * curvature_per_m
    lift = int(driver.lift_m / _TRACK_STEP_M)
    braking = force < 0.0
    ahead = np.zeros_like(braking)
    for metres in range(1, lift + 1):
        ahead |= np.roll(braking, -metres)
    force = np.where(ahead & ~braking, 0.0, force)
    mechanical = force * mean
    electrical = np.where(
        mechanical >= 0.0,
        np.minimum(mechanical, power_w) / car.drive_efficiency,
        np.maximum(mechanical * car.regeneration_part * car.drive_efficiency, -car.regeneration_w),
    )
    at_s = np.concatenate(([0.0], np.cumsum(_TRACK_STEP_M / mean)))
    wanted_s = np.arange(int(at_s[-1] / SAMPLE_S)) * SAMPLE_S
    # Mean power over each sample from the integral, so that no energy is lost between the grids.
    energy = np.concatenate(([0.0], np.cumsum(electrical * np.diff(at_s))))
    edges = np.append(wanted_s, wanted_s[-1] + SAMPLE_S) if len(wanted_s) else np.array([0.0])
    power = np.diff(np.interp(edges, at_s, energy)) / SAMPLE_S + car.standing_w
    return Lap(power, np.interp(wanted_s, at_s[:-1], speed))


class Event:
    """A power trace with its phases and laps: the base of all races."""

    def __init__(self, limits: PowerLimits) -> None:
        self._limits = limits
        self._starts_s: list[float] = []
        self._stints: list[tuple[Phase, int]] = []
        self.duration_s = 0.0
        self.power_w: FloatArray = np.zeros(0)
        self.speed_m_per_s: FloatArray = np.zeros(0)

    def add_pause(self, phase: Phase, lap: int, seconds: float, watts: float = 0.0) -> None:
        """Append a time in which the car does not move."""
        samples = round(seconds / SAMPLE_S)
        self._append(phase, lap, np.full(samples, watts), np.zeros(samples))

    def add_lap(self, lap: int, driven: Lap) -> None:
        """Append a lap."""
        self._append(Phase.DRIVING, lap, driven.power_w, driven.speed_m_per_s)

    def _append(self, phase: Phase, lap: int, power_w: FloatArray, speed_m_per_s: FloatArray) -> None:
        self._starts_s.append(self.duration_s)
        self._stints.append((phase, lap))
        self.power_w = np.concatenate((self.power_w, power_w))
        self.speed_m_per_s = np.concatenate((self.speed_m_per_s, speed_m_per_s))
        self.duration_s = len(self.power_w) * SAMPLE_S

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the current that gives the trace's power at the present voltage, within the limits [A]."""
        index = int(t_s / SAMPLE_S)
        if not 0 <= index < len(self.power_w):
            return 0.0
        power_w = float(self.power_w[index])
        return self._limits.current_a(power_w, view.outlet_voltage_v) if power_w else 0.0

    def state(self, t_s: float) -> LoadState:
        """Return phase, lap and speed at `t_s`."""
        if t_s >= self.duration_s:
            return LoadState(Phase.FINISHED, self._stints[-1][1] if self._stints else 0)
        stint = bisect_right(self._starts_s, max(t_s, 0.0)) - 1
        phase, lap = self._stints[stint]
        speed = float(self.speed_m_per_s[min(int(max(t_s, 0.0) / SAMPLE_S), len(self.speed_m_per_s) - 1)])
        return LoadState(phase, lap, speed)


def endurance(
    rng: np.random.Generator,
    *,
    driver: Driver | None = None,
    n_laps: int = 22,
    change_s: float = 180.0,
    standby_s: float = 5.0,
) -> Event:
    """Return the 22 km race: laps of about a kilometre, a change of drivers half way, high voltage off meanwhile."""
    car, driver = Car(), driver or Driver()
    track = autocross_track(rng)
    race = Event(car.limits)
    race.add_pause(Phase.STANDBY, 0, standby_s)
    race.add_pause(Phase.READY, 0, standby_s, car.standing_w)
    for lap in range(1, n_laps + 1):
        if lap == n_laps // 2 + 1:
            race.add_pause(Phase.READY, lap - 1, standby_s, car.standing_w)
            race.add_pause(Phase.DRIVER_CHANGE, lap - 1, change_s)
            race.add_pause(Phase.READY, lap - 1, standby_s, car.standing_w)
            driver = Driver(driver.grip_part * 0.985, driver.power_part * 0.98, driver.lap_spread, driver.lift_m)
        mood = 1.0 + driver.lap_spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        today = Driver(driver.grip_part * mood, driver.power_part * mood, driver.lap_spread, driver.lift_m)
        standing_start = lap in (1, n_laps // 2 + 1)
        race.add_lap(lap, drive_lap(car, today, track, start_m_per_s=1.0 if standing_start else None))
    race.add_pause(Phase.READY, n_laps, standby_s, car.standing_w)
    return race


def acceleration() -> Event:
    """Return four runs of 75 m with everything the inverter has, and the wait between them."""
    car = Car(power_w=80e3, limits=PowerLimits(max_discharge_w=78e3, max_discharge_a=195.0))
    return _runs(car, Driver(grip_part=1.0, power_part=1.0, lift_m=0.0), np.zeros(75), 4)


def skid_pad() -> Event:
    """Return two runs of the figure of eight: two circles right, two left, at the limit of side grip."""
    radius_m = 9.125  # centre line: 15.25 m inside diameter, 3 m wide
    circles = np.full(int(4 * 2.0 * np.pi * radius_m), 1.0 / radius_m)
    return _runs(Car(), Driver(grip_part=0.95), np.concatenate((np.zeros(15), circles, np.zeros(15))), 2)


def _runs(car: Car, driver: Driver, course: FloatArray, n_runs: int) -> Event:
    """Runs from a standing start, a minute apart."""
    event = Event(car.limits)
    for run in range(1, n_runs + 1):
        event.add_pause(Phase.READY, run - 1, 60.0 if run > 1 else 5.0, car.standing_w)
        event.add_lap(run, drive_lap(car, driver, course, start_m_per_s=0.5))
    event.add_pause(Phase.READY, n_runs, 5.0, car.standing_w)
    return event
