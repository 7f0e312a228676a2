# SPDX-License-Identifier: Apache-2.0
"""What answers one contact sample: fusion, the served surface, its states and figures."""
