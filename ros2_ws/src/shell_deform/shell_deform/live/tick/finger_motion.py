# SPDX-License-Identifier: Apache-2.0
"""Whether fingers that carry bodies can have come where they are said to be."""

from __future__ import annotations

import numpy as np

from shell_deform.live.tick.sample import ContactSample, SampleError

SMALLEST_ANGLE = 1e-3
"""A finger's own direction is at least so far from its normal, in sines."""


class FingerMotion:
    """Looks at one sample after the other; `width` [m] of the bodies, `reach` of their ends."""

    def __init__(self, width: float, reach: float) -> None:
        self._width, self._reach = width, reach
        self.forget()

    def forget(self) -> None:
        """Time has jumped: nothing is known of what was before."""
        self._last: ContactSample | None = None
        self._used: ContactSample | None = None

    def check(self, sample: ContactSample) -> None:
        """Raise SampleError for a finger that turned by more than its width in one sample.

        It may come back to where it was, or stay where it has come to: then it touches anew.
        """
        touching = sample.rows(sample.touching)
        self._check_direction(touching)
        last, self._last = self._last, touching
        why = self._leap(last, touching)
        if why and self._leap(self._used, touching):
            raise SampleError(why)
        self._used = touching

    def _leap(self, before: ContactSample | None, now: ContactSample) -> str:
        """Which finger has turned too far since a sample, in a sentence; '' for none."""
        if before is None:
            return ''
        for row, finger in enumerate(now.finger.tolist()):
            place = np.flatnonzero(before.finger == finger)
            if len(place) != 1 or np.count_nonzero(now.finger == finger) != 1:
                continue
            old = int(place[0])
            turned = _turned(before.normal[old], now.normal[row])
            turned = max(turned, _turned(before.along[old], now.along[row]))
            if turned * self._reach > self._width:
                return (
                    f'finger {finger} turned by {np.degrees(turned):.3g} degrees in one sample, '
                    f'more than its width of {1e3 * self._width:.3g} mm, so the sample is not '
                    'used; send more samples, or correct its pose'
                )
        return ''

    def _check_direction(self, sample: ContactSample) -> None:
        """Raise SampleError for a direction to the tip that is none."""
        cross = np.linalg.norm(np.cross(sample.along, sample.normal), axis=1)
        given = np.asarray(~np.isnan(sample.along).all(axis=1))
        length = np.linalg.norm(np.where(given[:, None], sample.along, 1.0), axis=1)
        bad = np.flatnonzero(given & ~(cross > SMALLEST_ANGLE * length))
        if len(bad):
            row = int(bad[0])
            raise SampleError(
                f'finger {int(sample.finger[row])}: its direction ax ay az is '
                f'{sample.along[row].tolist()}, which does not lie across its normal, so the '
                'sample is not used'
            )


def _turned(before: np.ndarray, now: np.ndarray) -> float:
    """Angle between two directions [rad], 0 where one is unknown."""
    sizes = np.linalg.norm(before) * np.linalg.norm(now)
    if not (np.isfinite(sizes) and sizes > 0.0):
        return 0.0
    return float(np.arccos(np.clip(before @ now / sizes, -1.0, 1.0)))
