# SPDX-License-Identifier: Apache-2.0
"""What pushes: loads, pins, and rigid pads in unilateral contact."""
