# SPDX-License-Identifier: Apache-2.0
"""Driver of the BH8-262 and other serial BarrettHands (Grasper Control Language, RS-232)."""
