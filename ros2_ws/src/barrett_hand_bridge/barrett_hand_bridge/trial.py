# SPDX-License-Identifier: Apache-2.0
"""A whole measurement, emulated: calibrate, tare, wait, grasp; how far off is the force?

Every seed draws another hand: gauges, mounting of the pins, stretch of the tendons, weight of the
links. The driver knows none of it; it has the nominal numbers and the calibration it fitted. A
misfit adds what the driver's models do not hold at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from barrett_hand_bridge.emulator.direct_port import DirectPort
from barrett_hand_bridge.emulator.geometry import FINGERS, MountedPin
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.misfit import MISFITS, misfit_body, misfit_gauges
from barrett_hand_bridge.emulator.serial_hand import SerialHand as EmulatedHand
from barrett_hand_bridge.emulator.squeeze import ForceTable, Pinched
from barrett_hand_bridge.emulator.weighing import weighing_table
from barrett_hand_bridge.fit import fit_hand, parse_weighings
from barrett_hand_bridge.gcl.driver import SerialHand
from barrett_hand_bridge.grasp import opposed_grasp
from barrett_hand_bridge.hand import ENCODER_262, HandSample
from barrett_hand_bridge.kinematics import HandGeometry, Pin
from barrett_hand_bridge.observer import HandObserver, Observation, ObserverSettings

WIDTH_M = 0.065
BALL = ForceTable((0.0, 0.00256, 0.00605, 0.00912, 0.01027), (0.0, 10.631, 16.503, 20.373, 21.485))
LOADS_N = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0)


@dataclass(frozen=True)
class ForceError:
    """One recovered force against the truth, with the sigma that was published. N."""

    seed: int
    true_n: float
    error_n: float
    sigma_n: float
    count_n: float


@dataclass(frozen=True)
class TravelError:
    """How far two opposed fingers have come since first touch, together, against the truth. m.

    releases: how many the driver had seen before, by which it knows the play of the tendons.
    """

    seed: int
    releases: int
    true_m: float
    error_m: float
    sigma_m: float


class Trial:
    """One emulated hand and the driver that measures with it, on simulated time."""

    def __init__(
        self,
        seed: int,
        *,
        follow_drift: bool = True,
        misfit: str = 'none',
        table: ForceTable = BALL,
    ) -> None:
        """A hand with opposed fingers, calibrated, initialised, seen open, not tared.

        `table`: how the ball of WIDTH_M between its pins resists.
        """
        self.seed = seed
        generator = np.random.default_rng([seed, 1])
        nominal = MountedPin()
        spread = 0.0005
        pins = {
            finger: replace(
                nominal,
                length_m=nominal.length_m + float(generator.normal(0.0, spread)),
                forward_m=nominal.forward_m + float(generator.normal(0.0, spread)),
                sideways_m=float(generator.normal(0.0, spread)),
            )
            for finger in FINGERS
        }
        body = HandBody(
            pins=pins,
            tendon_compliance_rad_per_nm={
                finger: 0.02 * float(generator.normal(1.0, 0.2)) for finger in FINGERS
            },
            outer_link_mass_kg=0.1 * float(generator.normal(1.0, 0.1)),
        )
        truth = MISFITS[misfit]
        self.mechanics = HandMechanics(
            misfit_body(body, truth), seed, Pinched((1, 2), WIDTH_M, table)
        )
        misfit_gauges(self.mechanics, truth)
        self.emulated = EmulatedHand(self.mechanics)
        fits = fit_hand(
            parse_weighings(weighing_table(self.mechanics, seed), f'seed {seed}'),
            kind='cubic',
            degree=3,
            zero='difference',
        )
        self.hand = SerialHand(
            lambda: DirectPort(self.emulated),
            clock_ns=lambda: round(self.mechanics.time_s * 1e9),
            baud=9600,
            prefetch=False,
        )
        self.hand.connect()
        self.hand.initialize()
        self.observer = HandObserver(
            ObserverSettings(
                {finger: fit.gauge for finger, fit in fits.items()}, follow_drift=follow_drift
            )
        )
        for _ in range(120):
            self.observer.observe(self.sample())
        grasp = opposed_grasp(HandGeometry(), Pin(), WIDTH_M + 0.010)
        self.open = {motor: float(c) for motor, c in grasp.counts(ENCODER_262).items()}
        self.mechanics.place(self.open)

    def sample(self, pause_s: float = 0.01) -> HandSample:
        """One cycle after a pause."""
        self.emulated.advance(pause_s)
        return self.hand.sample(None)

    def tare(self) -> str:
        """Tare in the present pose; returns the refusal, or an empty string."""
        return self.observer.tare([self.sample() for _ in range(100)]).refusal

    def wait(self, minutes: float, every_s: float = 20.0) -> None:
        """Let the free hand drift, looking at it in short spells."""
        for _ in range(round(60.0 * minutes / every_s)):
            self.mechanics.rest(every_s - 1.2)
            for _ in range(6):
                self.mechanics.rest(0.2)
                self.observer.observe(self.sample(0.0))

    def grasp(self, force_n: float, samples: int = 20) -> list[ForceError]:
        """Close until a force, hold, compare every sample of both fingers, open again."""
        start = dict(self.open)
        self.mechanics.place(start)
        self.mechanics.close_to_force(force_n, (1, 2))
        for _ in range(30):
            self.observer.observe(self.sample())
        errors = []
        for _ in range(samples):
            observation = self.observer.observe(self.sample())
            for finger in (1, 2):
                reading = observation.fingers[finger]
                gauge = self.observer.settings.calibrations[finger]
                zero = reading.zero_counts
                true = self.mechanics.truth(finger).force_n
                errors.append(
                    ForceError(
                        seed=self.seed,
                        true_n=true,
                        error_n=float(reading.contact.force @ reading.contact.normal) - true,
                        sigma_n=reading.contact.sigma_normal_n,
                        count_n=gauge.slope(zero, zero) / reading.arm_m,
                    )
                )
        self.mechanics.place(start)
        for _ in range(8):
            self.mechanics.rest(0.2)
            self.observer.observe(self.sample(0.0))
        return errors

    def close_slowly(
        self,
        force_n: float,
        steps: int = 60,
        samples: int = 3,
        watch: Callable[[Observation], None] = lambda _seen: None,
    ) -> list[TravelError]:
        """Close to a force step by step, looking at every step; how far have the pins travelled?

        Where the object hangs between two pins, only what both travel together squeezes it. The
        hand opens by the same steps. `watch` is told all that is observed on the way in.
        """
        start = dict(self.open)
        self.mechanics.place(start)
        self.mechanics.close_to_force(force_n, (1, 2))
        end = {finger: self.mechanics.motors[finger].position for finger in (1, 2)}

        def look(step: int) -> Observation:
            share = step / steps
            here = {f: (1.0 - share) * start[f] + share * end[f] for f in end}
            self.mechanics.place({**start, **here})
            return self.observer.observe(self.sample())

        releases = self.observer.tendons.releases
        for step in range(steps + 1):
            watch(look(step))
        errors = []
        for _ in range(samples):
            observation = self.observer.observe(self.sample())
            contacts = [observation.fingers[finger].contact for finger in (1, 2)]
            true = sum(float(self.mechanics.truth(f).displacement_m) for f in (1, 2))
            errors.append(
                TravelError(
                    self.seed,
                    releases,
                    true,
                    sum(contact.travel_m for contact in contacts) - true,
                    math.hypot(*(contact.sigma_travel_m for contact in contacts)),
                )
            )
        for step in reversed(range(steps)):
            look(step)
        return errors


def travel_errors(
    seeds: Sequence[int], *, loads_n: Sequence[float] = LOADS_N, misfit: str = 'none'
) -> list[TravelError]:
    """Errors of the travel, one tared hand per seed, every load from an open hand."""
    errors: list[TravelError] = []
    for seed in seeds:
        trial = Trial(seed, misfit=misfit)
        refusal = trial.tare()
        if refusal:
            raise RuntimeError(f'seed {seed}: {refusal}')
        for load in loads_n:
            errors += trial.close_slowly(load, samples=1)
            trial.wait(0.5)
    return errors


def force_errors(
    seeds: Sequence[int],
    *,
    drift_minutes: float = 30.0,
    loads_n: Sequence[float] = LOADS_N,
    follow_drift: bool = True,
    misfit: str = 'none',
) -> list[ForceError]:
    """Errors of the recovered forces after a time of drift, one hand per seed."""
    errors: list[ForceError] = []
    for seed in seeds:
        trial = Trial(seed, follow_drift=follow_drift, misfit=misfit)
        refusal = trial.tare()
        if refusal:
            raise RuntimeError(f'seed {seed}: {refusal}')
        trial.wait(drift_minutes)
        for load in loads_n:
            errors += trial.grasp(load)
    return errors


def coverage(errors: Sequence[ForceError], sigmas: float = 1.6449) -> float:
    """Share of errors within `sigmas` times their sigma (90 % level: 1.6449)."""
    return sum(abs(e.error_n) <= sigmas * e.sigma_n for e in errors) / len(errors)


def bias_counts(errors: Sequence[ForceError]) -> float:
    """Largest mean error over all hands at any load, in gauge counts."""
    loads = sorted({round(e.true_n, 1) for e in errors})
    worst = 0.0
    for load in loads:
        own = [e.error_n / e.count_n for e in errors if round(e.true_n, 1) == load]
        worst = max(worst, abs(math.fsum(own) / len(own)))
    return worst
