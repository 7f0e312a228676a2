# SPDX-License-Identifier: Apache-2.0
"""Emulated BarrettHands: the bytes of both hands, and the mechanics behind them.

Written from the maker's documents alone; nothing here is shared with the driver, so that an error
in one of the two shows up as a disagreement.
"""
