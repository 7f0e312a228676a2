# SPDX-License-Identifier: Apache-2.0
"""Driver of the BH8-280 and BH8-282 BarrettHands (Puck 2 motor controllers on CAN)."""
