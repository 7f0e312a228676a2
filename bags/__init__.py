# SPDX-License-Identifier: Apache-2.0
"""Recorded experiments and what makes them: solid truth, scanner, recording."""
