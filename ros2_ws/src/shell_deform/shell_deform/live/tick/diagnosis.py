# SPDX-License-Identifier: Apache-2.0
"""What /diagnostics says of the live estimator: a level, a sentence, and every figure."""

from __future__ import annotations

import os
from dataclasses import dataclass

from shell_deform.live.background.worker_link import WorkerLink
from shell_deform.live.tick.estimator import Estimator, Served
from shell_deform.live.tick.health import Figures, resident
from shell_deform.live.tick.modulus import ModulusEstimate
from shell_deform.live.tick.states import LiveState

CONTRADICTION_LIMIT = 3.0

CROSSES = (
    'the wall passes through itself: it has collapsed, and its sides are not held apart here; the '
    'surface that is served is none that the object can have'
)

TAKING_UP = 'taking up the contacts: until their equilibrium is found linear theory answers'


@dataclass(frozen=True)
class Condition:
    """The estimator and what surrounds it, at one moment.

    Attributes:
        state: as published.
        estimator, served: None before the shell is built, before the first answer.
        modulus: None while it is not learned. failure: why the shell cannot be built, or ''.
        unusable: why the last refused sample was refused, or ''.
    """

    state: LiveState
    figures: Figures
    link: WorkerLink
    estimator: Estimator | None
    served: Served | None
    modulus: ModulusEstimate | None
    failure: str
    unusable: str


def judge(condition: Condition) -> tuple[str, str]:
    """Level (ok, warn, error, stale) and one sentence."""
    served, estimator = condition.served, condition.estimator
    adopted = estimator.adopted if estimator is not None else None
    if condition.failure:
        return 'error', condition.failure
    if condition.state is LiveState.FAULT:
        return 'error', condition.unusable or 'a finger reports a fault'
    if condition.state is LiveState.STALE:
        return 'stale', 'no fresh contacts'
    if estimator is None:
        return 'warn', 'the background process is building the shell'
    if condition.link.trouble:
        return 'warn', f'the background process {condition.link.trouble}'
    if served is not None and served.contradiction > CONTRADICTION_LIMIT:
        return 'warn', f'force and motion contradict: {served.suspect}'
    if served is not None and served.taking_up and condition.state.is_served:
        return 'warn', TAKING_UP
    if adopted is not None and adopted.crosses:
        return 'warn', CROSSES
    if adopted is not None and adopted.share < 1.0:
        return 'warn', f'the last load case is not carried: {adopted.message}'
    if estimator.hold is not None and (beyond := estimator.hold.law.beyond(estimator.hold.oldest)):
        return 'warn', beyond
    if condition.link.worker.mesh_warning:
        return 'warn', condition.link.worker.mesh_warning
    if condition.state is LiveState.SATURATED:
        return 'warn', 'a gauge is saturated'
    return 'ok', condition.state.value


def values(condition: Condition, now: float) -> dict[str, object]:
    """Every figure by its name with its unit; `now` is steady [s], once a second or so."""
    figures, link = condition.figures, condition.link
    result: dict[str, object] = {
        'state': condition.state.value,
        'theory': link.worker.theory,
        'why this theory': link.worker.theory_reason,
        'trouble of the mesh': link.worker.mesh_warning,
        'messages': figures.arrivals,
        'samples': figures.stamps.samples,
        'lost': 'unknown' if figures.losses.lost is None else figures.losses.lost,
        'refused': figures.refused,
        'late': figures.stamps.late,
        'jumps of time': figures.stamps.jumps,
        'input rate [Hz]': figures.input_rate(now),
        'tick median [ms]': 1e3 * figures.ticks.percentile(50),
        'tick p99 [ms]': 1e3 * figures.ticks.percentile(99),
        'contacts in to surface out median [ms]': 1e3 * figures.answers.percentile(50),
        'contacts in to surface out p99 [ms]': 1e3 * figures.answers.percentile(99),
        'start to first surface [s]': figures.first_surface,
        'background restarts': link.restarts,
        'background alive': link.worker.alive,
        'background trouble': link.trouble,
        'background refreshes': figures.refreshes,
        'background refresh rate [Hz]': figures.refresh_rate(now),
        'memory of node and background [MB]': 1e-6
        * sum(resident(pid) for pid in (os.getpid(), *link.processes)),
    }
    served, estimator = condition.served, condition.estimator
    if estimator is not None and estimator.adopted is not None:
        adopted = estimator.adopted
        result['load cases overtaken'] = int(adopted.slot.record['dropped'])
        result['background solve [ms]'] = 1e3 * float(adopted.slot.record['seconds'])
        result['load carried'] = adopted.share
        result['stable'] = adopted.stable
        result['passes through itself'] = adopted.crosses
        result['object pose'] = ' '.join(f'{v:.5g}' for v in adopted.pose.numbers)
        result['background says'] = adopted.message
    if served is not None:
        result['nonlinear age [s]'] = served.nonlinear_age
        result['answer'] = served.answer
        result['stiffness error of the mesh'] = (
            float(estimator.adopted.coarseness.max(initial=0.0))
            if estimator is not None and estimator.adopted is not None
            else 0.0
        )
        result['error of the linear step [mm]'] = 1e3 * served.extrapolation
        result['contradiction'] = served.contradiction
        result['suspect'] = served.suspect
        result['unbalanced force [N]'] = estimator.unbalance if estimator is not None else 0.0
        result['snap margin'] = served.snap_margin
    if estimator is not None and estimator.hold is not None:
        law = estimator.hold.law
        result['pushes for [s]'] = estimator.hold.oldest
        result['relaxed force over elastic'] = float(law(estimator.hold.oldest))
        result["Young's modulus is that after [s]"] = law.reference
    if condition.modulus is not None:
        result["Young's modulus [Pa]"] = condition.modulus.value
        result["Young's modulus, sigma [Pa]"] = condition.modulus.sigma
    return result
