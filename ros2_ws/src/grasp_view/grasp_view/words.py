# SPDX-License-Identifier: Apache-2.0
"""What the page says in words: the state and what it means for the numbers shown, as HTML."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .colour_map import three_digits
from .scene_model import CONTACT, DISPLACEMENT, SATURATED, Snapshot, touches
from .surface_layer import Legend

RESET_TOLD_S = 4.0
# Label in the table of numbers: name in `Snapshot.numbers`, SI unit.
NUMBERS = {
    'linear theory off by': ('linearity', ''),
    'strain energy': ('strain_energy', 'J'),
    'nonlinear answer, age': ('nonlinear_age', 's'),
    'scan to surface, mean': ('mean_error', 'm'),
    'scanner noise floor': ('noise_floor', 'm'),
}
ICONS = {
    'free': '<circle cx="12" cy="12" r="8"/>',
    'contact': '<circle cx="12" cy="12" r="9"/><circle class="f" cx="12" cy="12" r="4.5"/>',
    'taking': '<path d="M12 3a9 9 0 1 0 9 9"/><circle class="f" cx="12" cy="12" r="3"/>',
    'saturated': '<path d="M12 3 22 20H2Z"/><path d="M12 9v5M12 16.5v1"/>',
    'stale': '<circle cx="12" cy="12" r="9"/><path d="M12 6.5V12l4 2.5"/>',
    'fault': '<path d="M8 3h8l5 5v8l-5 5H8l-5-5V8Z"/><path d="m8.5 8.5 7 7m0-7-7 7"/>',
}


@dataclass(frozen=True)
class Told:
    """The state: its word, its kind (`ICONS`), and one sentence."""

    word: str
    kind: str
    sentence: str


def with_unit(value: float, unit: str) -> str:
    """A number in SI as people read it: m in mm, J in mJ, s in ms below one second, 1 in %."""
    factor, shown = {'m': (1e3, 'mm'), 'J': (1e3, 'mJ'), 's': (1e3, 'ms'), '': (1e2, '%')}[unit]
    if unit == 's' and value >= 1.0:
        return f'{value:.1f} s'
    return f'{three_digits(value * factor)} {shown}'


def _fingers(snapshot: Snapshot, flag: int) -> str:
    contacts = snapshot.contacts
    if contacts is None:
        return 'a finger'
    named = sorted({int(f) for f in contacts.finger[contacts.flags & flag > 0]})
    return ' and '.join(f'F{number}' for number in named) or 'a finger'


def told(snapshot: Snapshot, answer_age: float, since_reset: float) -> Told:
    """What is so now; ages in s, NaN or infinite where nothing came or happened."""
    state = snapshot.state
    old = f'{answer_age:.1f} s' if np.isfinite(answer_age) else 'some time'
    if state == 'FAULT':
        return Told(state, 'fault', f'{snapshot.trouble or "a node stopped"}; last answer kept')
    if state == 'STALE':
        return Told(state, 'stale', f'no fresh hand data for {old}; last answer kept')
    if since_reset < RESET_TOLD_S:
        return Told(
            'RESET', 'taking', 'the time has jumped; the answer starts anew from its last shape'
        )
    pressed = bool(touches(snapshot)) and state in ('CONTACT', 'SATURATED')
    if pressed and snapshot.answer == 'taking up':
        return Told(
            'TAKING UP',
            'taking',
            'new contact, solving its shape; linear theory answers meanwhile',
        )
    if state == 'SATURATED':
        who = _fingers(snapshot, SATURATED)
        return Told(state, 'saturated', f'gauge of {who} at its end: the force is a lower bound')
    if state == 'CONTACT':
        contacts = snapshot.contacts
        count = 0 if contacts is None else int((contacts.flags & CONTACT > 0).sum())
        fingers = f'{count} contact{"s" if count != 1 else ""}, ' if count else ''
        return Told(state, 'contact', f'{fingers}the answer follows every sample')
    if state == 'FREE':
        return Told(state, 'free', 'no finger touches the object')
    if state == 'NO_HAND':
        return Told('NO HAND', 'free', 'nobody publishes contacts')
    return Told(
        html.escape(state) or 'WAITING', 'free', 'for a deformation node to publish its state'
    )


def state_html(now: Told) -> str:
    """The banner: icon, word, sentence."""
    return (
        f'<div class="grasp-banner {now.kind}" role="status"><svg viewBox="0 0 24 24" '
        f'aria-hidden="true">{ICONS[now.kind]}</svg><div><b class="grasp-state">{now.word}</b>'
        f'<span>{html.escape(now.sentence)}</span></div></div>'
    )


def largest_text(snapshot: Snapshot, now: Told) -> str:
    """The one number in a few signs; empty while it is not known."""
    value = snapshot.numbers.get('max_displacement', np.nan)
    if not np.isfinite(value) or (now.kind == 'taking' and not value > 1e-6):
        return ''
    return f'{three_digits(value * 1e3)} mm'


def largest_html(snapshot: Snapshot, now: Told) -> str:
    """The one number: the largest displacement with its sigma; never a bare 0 under force."""
    surface = snapshot.surface('served')
    value = snapshot.numbers.get('max_displacement', np.nan)
    if surface is None or not np.isfinite(value):
        return '<div class="grasp-largest"><b>–</b><p>largest displacement</p></div>'
    sigma = float(surface.sigma[int(np.linalg.norm(surface.moved, axis=1).argmax())])
    plus = f' ± {float(f"{sigma * 1e3:.2g}"):g}' if np.isfinite(sigma) else ''
    waiting = now.kind == 'taking'
    number = '…' if waiting and not value > 1e-6 else three_digits(value * 1e3)
    meaning = {
        'taking': 'largest displacement until the equilibrium is found',
        'stale': 'largest displacement of the last answer',
        'fault': 'largest displacement of the last answer',
        'saturated': 'largest displacement, at least',
    }.get(now.kind, 'largest displacement, middle surface')
    faded = ' faded' * (now.kind in ('taking', 'stale', 'fault'))
    return (
        f'<div class="grasp-largest{faded}"><b>{number}</b><span>{plus} mm</span>'
        f'<p>{meaning}</p></div>'
    )


def numbers_of(snapshot: Snapshot, legend: Legend) -> dict[str, str]:
    """The other numbers with their units, only those that are known."""
    lines = {
        label: with_unit(snapshot.numbers[name], unit)
        for label, (name, unit) in NUMBERS.items()
        if np.isfinite(snapshot.numbers.get(name, np.nan))
    }
    if legend.quantity is not DISPLACEMENT:
        largest = f'{three_digits(legend.largest)} {legend.quantity.unit}'
        lines[f'largest {legend.quantity.name}'] = largest
    return lines


def numbers_html(lines: Mapping[str, str]) -> str:
    """A table of numbers."""
    cells = ''.join(
        f'<dt>{html.escape(key)}</dt> <dd>{html.escape(value)}</dd> '
        for key, value in lines.items()
    )
    return f'<dl class="grasp-numbers">{cells}</dl>'


def header_html(snapshot: Snapshot) -> str:
    """Object, theory, recording and where its numbers come from: on every picture of the page."""
    name = html.escape(snapshot.object_name or 'no object yet')
    parts = [f'<b>{name}</b>']
    synthetic = snapshot.recording.partition(': ')[2].startswith('SYNTHETIC')
    if synthetic:
        parts.append('<em>SYNTHETIC</em>')
    if snapshot.theory:
        parts.append(f'<span class="wide">{html.escape(snapshot.theory)}</span>')
    if snapshot.recording:
        recording, _, label = snapshot.recording.partition(': ')
        parts.append(f'<span class="recording">{html.escape(recording)}</span>')
        label = label.removeprefix('SYNTHETIC').removeprefix(': ')
        if label:
            parts.append(f'<span class="wide label">{html.escape(label)}</span>')
    return ''.join(parts)
