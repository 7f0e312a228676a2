# SPDX-License-Identifier: Apache-2.0
"""The option that the commands of this package share."""

from __future__ import annotations

import argparse

from grasp_common.options import add

MODELS = ('262', '280')


def add_hand(parser: argparse.ArgumentParser) -> None:
    """`--hand`: a model of the BarrettHand, with or without its `BH8-`."""
    add(
        parser,
        '--hand',
        ', with or without BH8- (default 262)',
        type=lambda text: text.upper().removeprefix('BH8-'),
        choices=MODELS,
        default=MODELS[0],
    )
