# SPDX-License-Identifier: Apache-2.0
"""The project's pictures, drawn by the project itself; `make pictures` runs them all."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / 'docs' / 'pictures'
BALL = 'tennis_ball'
BAG = ROOT / 'bags' / 'tennis_ball_two_finger'
