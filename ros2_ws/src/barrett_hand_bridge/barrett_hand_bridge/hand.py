# SPDX-License-Identifier: Apache-2.0
"""What every BarrettHand driver gives and takes, whatever its wire: samples, facts, commands."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

FINGERS = (1, 2, 3)
SPREAD = 4


class HandError(Exception):
    """The hand cannot be used as asked; the message names the hand, the matter and the remedy."""


class HandNotInitialisedError(HandError):
    """The hand answers but its motors have not found their zero yet."""


class HandDisturbedError(HandError):
    """One cycle failed, but the hand has been found again and is as it was."""


@dataclass(frozen=True)
class EncoderScale:
    """Radians of joint travel per encoder count (BH8-262 manual for firmware 4.4, page 77)."""

    finger_rad_per_count: float
    spread_rad_per_count: float


ENCODER_262 = EncoderScale(math.radians(140.0) / 17500.0, math.pi / 3150.0)
ENCODER_280 = EncoderScale(math.radians(140.0) / 199111.1, math.pi / 35840.0)


@dataclass(frozen=True)
class HandFacts:
    """What a hand says about itself when it is connected.

    `speed_step_rad_s`: the slowest speed of joint 2, and the step of all; `warnings`: what it
    lacks, a sentence each; `settings`: what was read from it, for diagnostics.
    """

    model: str
    firmware: str
    serial_number: str
    encoder: EncoderScale
    highest_gauge_count: int
    ceiling_hz: float
    speed_step_rad_s: float = 0.0
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class HandSample:
    """One cycle of readings.

    `stamp_ns` is the time of the first byte (or frame) of the answer. Motor positions in encoder
    counts; `gauge_counts` None where no gauge is fitted. `inner_rad` comes from inner-link
    encoders where the hand has them; `breakaway_counts` is the motor position at which a finger's
    clutch let go, None while it holds. `strain_limits`: HSG, the reading at which the hand itself
    acts, None where there is none. `relieving`: the finger drives itself back to protect its
    gauge. `tactile_n_per_cm2`: 24 cells per finger (and 4 = palm). `clutch_open`: the finger broke
    away, None where the hand does not tell. `motors`: what motor controllers say of themselves, by
    motor and by the name of the property, as they give it.
    """

    stamp_ns: int
    finger_counts: tuple[int, int, int]
    spread_counts: int
    gauge_counts: tuple[int | None, int | None, int | None]
    breakaway_counts: tuple[int | None, int | None, int | None] = (None, None, None)
    inner_rad: tuple[float | None, float | None, float | None] = (None, None, None)
    temperature_c: float | None = None
    strain_limits: tuple[int | None, int | None, int | None] = (None, None, None)
    relieving: tuple[bool, bool, bool] = (False, False, False)
    tactile_n_per_cm2: Mapping[int, tuple[float, ...]] | None = None
    clutch_open: tuple[bool | None, bool | None, bool | None] = (None, None, None)
    motors: Mapping[int, Mapping[str, int]] = field(default_factory=dict)


class Guard(Protocol):
    """Stops the hand if this process dies."""

    def dismiss(self) -> None:
        """No longer needed."""

    def watch(self) -> bool:
        """Whether it had died and was started again; to be asked now and then."""


class Hand(Protocol):
    """A driver. Every call may block; only one thread may use it, `abort` excepted.

    Velocities are those of joint 2 per finger and of the spread, in rad/s, positive to close and
    to spread.
    """

    late: Callable[[], None]

    def connect(self) -> HandFacts:
        """Find the hand, read what it is, prepare it for cycles (nothing moves)."""

    def initialize(self) -> None:
        """Let all motors find their zero (they move)."""

    def sample(self, velocities: Mapping[int, float] | None) -> HandSample:
        """One cycle: command velocities if given, read everything back."""

    def open_by_itself(self, speeds: Mapping[int, float]) -> bool:
        """Let fingers open at speeds in rad/s without being told in every cycle, and end there.

        False where the hand cannot in the mode that it is used in.
        """

    def limit_force(self, counts: Mapping[int, int | None]) -> None:
        """Set the hand's own strain limit per finger in counts (None: no limit)."""

    def tare_touch(self) -> None:
        """Take what the touch cells feel now as nothing, where the hand has any."""

    def watch_guard(self) -> bool:
        """Whether the stop guard had died and was started again."""

    def stop(self) -> None:
        """Stop all motors."""

    def abort(self) -> None:
        """Interrupt a blocking call of another thread and stop all motors."""

    def close(self) -> None:
        """Stop all motors and let go of the line. Never raises."""
